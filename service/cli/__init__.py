"""The command line, lightlayers: what people separate, serve, capture and manage with.

Exit codes: 0 with results, 1 for a failure that is not the user's, 2 for bad input, 130 for
Ctrl-C, 143 and 129 for SIGTERM and SIGHUP. Whatever goes wrong is one sentence on stderr.
"""

from __future__ import annotations

import codecs
import io
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from service.cli import signals

_GROUPS = ((), ("calibrate",), ("keys",), ("jobs",))
"""Words that a command has to follow; alone they show which ones there are."""


def main() -> None:
    """Run the command that the process was started with."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    signals.install()
    if sys.stdin is None:  # it was closed: that is its end, too
        sys.stdin = Path(os.devnull).open()  # noqa: SIM115
    if sys.stderr is None:  # what is printed on None goes to stdout
        sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        codecs.register_error("escape-or-replace", _escape_or_replace)
        sys.stdout.reconfigure(errors="escape-or-replace")  # stderr never fails by itself
    sys.exit(run(sys.argv[1:]))


def _escape_or_replace(error: UnicodeError) -> tuple[str | bytes, int]:
    """Give bytes of paths as they are, and ? for what the encoding of a stream does not have."""
    try:
        return codecs.lookup_error("surrogateescape")(error)
    except UnicodeError:
        return codecs.lookup_error("replace")(error)


def run(arguments: Sequence[str]) -> int:
    """Run a command and give its exit code; without arguments, show what there is."""
    try:
        return _run_or_explain(arguments)
    except KeyboardInterrupt:  # also while a failure is being explained
        return 130


def _run_or_explain(arguments: Sequence[str]) -> int:
    try:
        return _run(arguments)
    except Exception as error:
        if ended := signals.exit_code():
            return ended
        from service.cli.explain import explain
        from service.cli.files import say

        sentence, code = explain(error)
        say(sentence)
        return code


def _run(arguments: Sequence[str]) -> int:
    # Imported only here, where Ctrl-C ends in silence: it takes most of the time until --help.
    import typer

    from pipeline.errors import own_words
    from service.cli.commands import app
    from service.cli.files import say

    given = [*arguments, "--help"] if tuple(arguments) in _GROUPS else list(arguments)
    try:
        return app(given, prog_name="lightlayers", standalone_mode=False) or 0
    except typer.TyperException as error:
        message = own_words(error.format_message())
        say(" ".join(message.split()).rstrip(".") + ".")
        return error.exit_code
    except typer.Abort:
        return 130
