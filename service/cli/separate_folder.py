"""Separates all pairs of a folder, and says which photographs were in none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from pipeline.decode.signatures import Kind, kind_of
from pipeline.errors import InputError, reason_of
from pipeline.options import Options
from pipeline.pair.find_pairs import Pairs, find_pairs, read_shot
from pipeline.process import separate_files
from pipeline.progress import Progress
from service.cli import signals
from service.cli.display import chip_of, print_json, stage_bar, temperature_of
from service.cli.explain import explain
from service.cli.files import read_file, say, shown
from service.cli.keeping import kept_for
from service.cli.results_folder import new_results
from service.cli.shooting import RECIPE

_NO_FLASH, _FLASH = "_no_flash.", "_flash."
_HOLD_LESS: Mapping[Kind | None, int] = {"JPEG": 0, "HEIF": 1}
"""Kinds of which cameras write one beside their RAW file, and phones both, by what they hold."""
_LARGEST = 2**30  # bytes; the largest cameras write a third of that
REFUSED = 2
"""Exit code when a pair could not be separated, or a file is in none as it could not be read."""

_UNREAD = "it cannot be read"
_DAMAGED = "it is a photograph that cannot be read, damaged or too large"


def separate_folder(folder: Path, output: Path, options: Options, as_json: bool) -> int:
    """Separate every pair of a folder into a folder of its own in `output`; the exit code.

    A pair that cannot be separated, whatever the reason, does not keep the others from it. Raises
    InputError where the folder cannot be read or has no pair.
    """
    pairs = _pairs_of(folder, output)
    if not pairs.found:
        raise InputError(_no_pair(folder, pairs))
    results: list[dict[str, Any]] = []
    for number, (no_flash, flash) in enumerate(pairs.found, 1):
        say(f"Pair {number} of {len(pairs.found)}: {no_flash}, {flash}")
        target = output / _own_name(no_flash, [first for first, _ in pairs.found])
        result: dict[str, Any] = {"no_flash": no_flash, "flash": flash, "folder": str(target)}
        try:
            result |= {"manifest": _separate(folder, no_flash, flash, target, options)}
        except Exception as error:
            if signals.exit_code():  # of which compiled loops make another error
                raise
            result |= {"error": explain(error)[0]}
        results.append(result)
    if as_json:
        print_json({"pairs": results, "left": pairs.left})
    else:
        _print(results, pairs.left)
    failed = any("error" in result for result in results)
    unread = any(reason.startswith((_UNREAD, _DAMAGED)) for reason in pairs.left.values())
    return REFUSED if failed or unread else 0


def _pairs_of(folder: Path, output: Path) -> Pairs:
    shots = {}
    unreadable: dict[str, str] = {}
    holds: dict[str, int] = {}
    for path in _listed(folder):
        printable = path.name.encode(errors="backslashreplace").decode()
        if printable != path.name:  # their results could not be named after them
            unreadable[printable] = "its name is not UTF-8, so rename it"
            continue
        try:
            if path.is_dir():
                if path.resolve() != output.resolve():
                    unreadable[path.name] = "it is a folder of its own, to be named alone"
                continue
            if not path.is_file() or path.stat().st_size > _LARGEST:
                unreadable[path.name] = "it is no photograph"
                continue
            data = path.read_bytes()
        except OSError as error:
            unreadable[path.name] = f"{_UNREAD}: {reason_of(error)}"
            continue
        try:
            shots[path.name] = read_shot(data)
        except InputError:
            known = kind_of(data) is not None
            unreadable[path.name] = _DAMAGED if known else "it is no photograph"
            continue
        holds[path.name] = _HOLD_LESS.get(kind_of(data), len(_HOLD_LESS))
    twins = _twins(holds)
    named = _pairs_by_name(name for name in shots if name not in twins)
    rest = shots.keys() - twins - {name for pair in named for name in pair}
    found = find_pairs({name: shots[name] for name in shots if name in rest})
    beside = dict.fromkeys(twins, "another file of this name holds more of the photograph")
    return Pairs(named + found.found, dict(sorted((found.left | beside | unreadable).items())))


def _listed(folder: Path) -> list[Path]:
    """List a folder but for hidden files and recipes, by name. Raises InputError."""
    try:
        return sorted(
            path
            for path in folder.iterdir()
            if not path.name.startswith(".") and not path.name.endswith(RECIPE)
        )
    except NotADirectoryError as error:
        raise InputError(
            f"{folder} is one photograph: name the one with the flash, too, or a folder of pairs."
        ) from error
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be read: {reason_of(error)}.") from error


def _twins(holds: Mapping[str, int]) -> set[str]:
    """Names beside which another file of the same stem holds more of the photograph.

    holds: by name, how much, as in _HOLD_LESS.
    """
    most: dict[str, int] = {}  # by stem, whose case cards and programs change
    for name, much in holds.items():
        stem = Path(name).stem.casefold()
        most[stem] = max(most.get(stem, 0), much)
    return {name for name, much in holds.items() if much < most[Path(name).stem.casefold()]}


def _pairs_by_name(names: Iterable[str]) -> list[tuple[str, str]]:
    """Find what `lightlayers capture` took; in a burst, times do not tell what belongs together."""
    known = set(names)
    spelt = {name.casefold(): name for name in known}
    pairs: dict[str, str] = {}  # by the second, which is in one pair
    for first in sorted(known):
        second = first.replace(_NO_FLASH, _FLASH)
        if second == first or second not in known:
            # cards and programs change the case, of one file at times
            second = spelt.get(first.casefold().replace(_NO_FLASH, _FLASH), first)
        if _NO_FLASH in first.casefold() and second != first:
            pairs.setdefault(second, first)
    return [(first, second) for second, first in pairs.items()]


def _no_pair(folder: Path, pairs: Pairs) -> str:
    if not pairs.left:
        return f"The folder {folder} is empty."
    name, reason = next(iter(pairs.left.items()))
    return (
        f"The folder {folder} has no pair, taken with and without the flash shortly after each "
        f"other: {name}, for one: {reason}. Where EXIF does not tell, call the two …_no_flash and "
        "…_flash."
    )


def _own_name(no_flash: str, all_of_them: list[str]) -> str:
    stem = Path(no_flash).stem
    return no_flash if [Path(name).stem for name in all_of_them].count(stem) > 1 else stem


def _separate(
    folder: Path, no_flash: str, flash: str, target: Path, options: Options
) -> dict[str, Any]:
    with new_results(target) as results, stage_bar() as report:
        kept = kept_for(options.setup)
        return separate_files(
            read_file(folder / no_flash, "photograph"),
            read_file(folder / flash, "photograph"),
            options,
            results,
            Progress(report),
            kept=kept,
        )


def _print(results: list[dict[str, Any]], left: Mapping[str, str]) -> None:
    console = Console(highlight=False)
    columns = (
        Column(name, overflow="fold") for name in ("photographs", "lamps", "warnings", "results")
    )
    table = Table(*columns)
    for result in results:
        names = Text(f"{shown(result['no_flash'])}\n{shown(result['flash'])}")
        if "error" in result:
            table.add_row(names, "", "", Text(shown(result["error"])))
            continue
        manifest = result["manifest"]
        codes = "\n".join(warning["code"] for warning in manifest["warnings"])
        table.add_row(names, _lamps(manifest["lamps"]), codes, Text(shown(result["folder"])))
    console.print(table)
    for name, reason in left.items():
        console.print(Text(shown(f"Left out: {name}: {reason}.")), soft_wrap=True)


def _lamps(lamps: list[Mapping[str, Any]]) -> Text:
    lines = []
    for lamp in lamps:
        lines.append(Text.assemble(chip_of(lamp), f" {temperature_of(lamp, lamp['family'])}"))
    return Text("\n").join(lines)
