from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import httpx
import pytest

from pipeline import process
from pipeline.errors import UnusablePairError
from service.api.context import Context
from service.cli import run
from service.sending.client import Client
from service.sending.failures import ServiceAwayError
from service.workers.shortage import TOO_LITTLE_MEMORY
from tests.unit.service.asking import rows_of
from tests.unit.service.at_first import raising


def _refused(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 2) -> str:
    """Run what must fail; the sentence on stderr."""
    assert run(arguments) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert "Traceback" not in said.err and said.err.endswith(".\n")
    return said.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--lights", "4"], "more than three lamps"),
        (["--lights", "many"], "lights"),
        (["--basis", "svd"], "basis"),
        (["--focal-px", "wide"], "'--focal-px': Input should be a valid number"),
        (["--exposure-ratio", "-2"], "exposure_ratio"),
        (["--outputs", "lamp9.gif"], "lamp9.gif"),
        (["--light-directions", "nothing.json"], "nothing.json cannot be read"),
        (["--camera", "nothing.csv"], "nothing.csv cannot be read"),
        (["--fast"], "No such option: --fast"),
    ],
)
def test_options_that_cannot_be_used_are_one_sentence(
    arguments: list[str],
    words: str,
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = _refused(capsys, "separate", *pair, "-o", str(tmp_path / "out"), *arguments)
    assert words in said
    assert not (tmp_path / "out").exists()


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"lightlayers {version('lightlayers')}\n"


def test_photographs_that_cannot_be_opened_are_told(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "out")]
    for command in ("separate", "submit"):
        said = _refused(capsys, command, str(tmp_path / "nothing.jpg"), pair[1], *out)
        assert "nothing.jpg cannot be read: no such file or directory." in said
        said = _refused(capsys, command, pair[0], str(tmp_path), *out)
        assert "cannot be read: is a directory." in said


def test_a_separation_loads_nothing_of_the_service(pair: list[str], tmp_path: Path) -> None:
    """Imports that it has no use for cost time in every run."""
    program = "import sys; from service.cli import run; run(sys.argv[1:]); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program, "separate", *pair, "-o", str(tmp_path / "out")],
        capture_output=True,
        text=True,
    )
    loaded = set(done.stdout.splitlines()[-1].split())
    assert (tmp_path / "out" / "manifest.json").exists()
    assert loaded.isdisjoint({"sqlalchemy", "obstore", "fastapi", "dbos", "drivers", "httpx"})


@pytest.mark.parametrize(
    ("data", "words"),
    [(b"", "empty"), (b"dear diary", "without the flash"), (b"\xff\xd8\xff\xe0", "damaged")],
)
def test_photographs_that_cannot_be_read_are_told(
    data: bytes,
    words: str,
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path(pair[0]).write_bytes(data)
    assert words in _refused(capsys, "separate", *pair, "-o", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_told(
    pair: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    said = _refused(capsys, "separate", *pair, "-o", pair[0])
    assert "cannot be written: file exists." in said
    said = _refused(capsys, "capture", "sim://studio?width=64&height=64", "-o", pair[0])
    assert "cannot be written: file exists." in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["separate"], "Missing argument"),
        (["separate", "a.jpg", "b.jpg"], "Missing option"),
        (["separate", "a.jpg", "b.jpg", "c.jpg", "-o", "out"], "unexpected extra argument"),
        (["separat"], "No such command"),
        (["serve", "--port", "99999"], "port"),
        (["serve", "--port", "http"], "'--port': Input should be a valid integer"),
        (["capture", "nowhere://x", "-o", "out"], "sim://"),
        (["capture", "sim://garden", "-o", "out"], "sim://studio"),
        (["capture", "sim://studio?lights=9", "-o", "out"], "lights"),
    ],
)
def test_commands_that_cannot_be_understood_are_one_sentence(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert words in _refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"), [("", "--output is empty"), ("o\udcff.jpg", "'o\\udcff.jpg' is not UTF-8")]
)
@pytest.mark.parametrize(
    "arguments",
    [
        ["separate", "a.jpg", "b.jpg"],
        ["separate", "."],
        ["submit", "a.jpg", "b.jpg"],
        ["capture", "sim://studio"],
        ["mix", "."],
        ["report", "."],
        ["calibrate", "flash", "a.jpg", "b.jpg"],
    ],
)
def test_names_that_nothing_can_be_written_to_are_told_first(
    arguments: list[str],
    name: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Nothing that the arguments name is there; an empty name is the current folder for Path."""
    monkeypatch.chdir(tmp_path)
    assert words in _refused(capsys, *arguments, "-o", name)
    assert list(tmp_path.iterdir()) == []


def test_a_setting_that_cannot_be_used_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_JOB_SECONDS", "soon")
    said = _refused(capsys, "worker")
    assert said.startswith("LIGHTLAYERS_JOB_SECONDS: Input should be a valid number")


def test_a_service_that_is_not_there_is_told(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = ["--url", "http://127.0.0.1:9"]
    said = _refused(capsys, "submit", *pair, "-o", str(tmp_path / "out"), *url, code=1)
    assert "http://127.0.0.1:9 does not answer" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("call", "error", "code", "said"),
    [
        ("wait", ServiceAwayError("The service does not answer."), 1, "does not answer.\n"),
        ("wait", KeyboardInterrupt(), 130, ""),
        ("download", OSError(28, "No space left on device"), 2, "no space left on device.\n"),
    ],
)
def test_the_job_is_named_whatever_ends_the_wait_for_its_results(
    call: str,
    error: BaseException,
    code: int,
    said: str,
    pair: list[str],
    tmp_path: Path,
    http: httpx.Client,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(Client, "wait", lambda _client, job, _report: job)
    monkeypatch.setattr(Client, call, raising(error))
    out = str(tmp_path / "out")
    assert run(["submit", *pair, "-o", out, "--url", str(http.base_url)]) == code
    (job,) = rows_of(context)
    _, found, after = capsys.readouterr().err.partition(f"The job is {job.id}.\n")
    assert found and after.endswith(said)


@pytest.mark.parametrize("url", ["photos", "ftp://localhost", "http://", "http://a b/"])
def test_an_address_that_is_no_services_is_told(
    url: str, pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = _refused(capsys, "submit", *pair, "-o", str(tmp_path / "out"), "--url", url)
    assert "http://" in said


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (
            ZeroDivisionError("Light."),
            1,
            r".*please report it: ZeroDivisionError in test_commands\.py.*",
        ),
        (UnusablePairError("The pair is black."), 2, r"The pair is black\."),
        (MemoryError(), 1, re.escape(TOO_LITTLE_MEMORY)),
    ],
)
def test_a_fault_of_the_program_is_told_from_bad_input_without_a_trace(
    error: Exception,
    code: int,
    told: str,
    pair: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def failing(*_arguments: object, **_kept: object) -> None:
        raise error

    monkeypatch.setattr(process, "separate_files", failing)
    said = _refused(capsys, "separate", *pair, "-o", str(tmp_path / "out"), code=code)
    assert re.fullmatch(f"{told}\n", said)


def test_the_shell_completes_commands(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_LIGHTLAYERS_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "lightlayers sep")
    monkeypatch.setenv("COMP_CWORD", "1")
    with pytest.raises(SystemExit) as ended:
        run([])
    assert (ended.value.code, capsys.readouterr().out.split()) == (0, ["separate"])


MANIFEST = {
    "lamps": [
        {
            "name": "lamp1",
            "rgb": [0.25, 0.5, 1],
            "cct_k": 2856.4,
            "duv": -0.0123,
            "srgb": "#80c0ff",
            "family": "mercury or metal halide",
            "family_confidence": 0.934,
            "confidence": 0.9,
        }
    ],
    "files": [{"name": "lamp1.jpg"}],
    "warnings": [{"code": "lamps_alike", "message": "The lamps are alike.", "figures": {}}],
}


@pytest.fixture
def separated(monkeypatch: pytest.MonkeyPatch) -> None:
    def separate(
        _no_flash: bytes,
        _flash: bytes,
        _options: object,
        folder: Path,
        _progress: object,
        kept: object,  # noqa: ARG001
    ) -> dict[str, object]:
        for name in ("lamp1.jpg", "manifest.json"):
            (folder / name).write_text(name)
        return MANIFEST

    monkeypatch.setattr(process, "separate_files", separate)


@pytest.mark.usefixtures("separated")
def test_a_summary_is_printed(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(["separate", *pair, "-o", str(out)]) == 0
    said = capsys.readouterr()
    assert "0.250 0.500 1.000" in said.out
    assert "2856 K" in said.out
    assert "-0.012" in said.out
    assert "mercury or" in said.out
    assert "halide" in said.out
    assert "0.93" in said.out
    assert str(out / "lamp1.jpg") in said.out
    assert "Warning: The lamps are alike." in said.out
    assert said.err == ""
    assert (out / "manifest.json").read_text() == "manifest.json"


@pytest.mark.usefixtures("separated")
def test_a_photograph_is_not_lost_to_a_result(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photograph = Path(pair[0]).rename(tmp_path / "lamp1.jpg")
    data = photograph.read_bytes()
    said = _refused(capsys, "separate", str(photograph), pair[1], "-o", str(tmp_path))
    assert f"The file {photograph} would be lost" in said
    assert photograph.read_bytes() == data


@pytest.mark.usefixtures("separated")
def test_json_is_the_manifest_and_nothing_else(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["separate", *pair, "-o", str(tmp_path / "out"), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == MANIFEST
    assert said.err == ""


def test_help_names_every_flag(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["separate", "--help"]) == 0
    said = capsys.readouterr().out
    for flag in (
        "--lights", "--method", "--basis", "--camera", "--flash-spectrum", "--encoding",
        "--flash-only", "--exposure-ratio", "--no-align", "--neutral", "--light-directions",
        "--pin-lamp", "--forbid-lamp",
        "--response", "--focal-px", "--outputs", "--json", "-o",
    ):  # fmt: skip
        assert flag in said


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    said = capsys.readouterr().out
    for command in (
        "separate", "serve", "worker", "submit", "cameras", "capture", "migrate", "jobs", "doctor",
    ):  # fmt: skip
        assert f"\n  {command} " in said


def test_no_arguments_at_all_show_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 0
    bare = capsys.readouterr().out
    assert run(["--help"]) == 0
    assert bare == capsys.readouterr().out


@pytest.mark.parametrize("group", ["calibrate", "keys", "jobs"])
def test_a_group_alone_shows_its_commands(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([group]) == 0
    said = capsys.readouterr()
    assert said.err == "" and f"Usage: lightlayers {group}" in said.out
    assert "\nCommands:\n" in said.out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["tether", "--server", "http://127.0.0.1:1", "--camera"], 0, "Press Enter to take"),
        (["capture", "-o", "out", "--flash", "operator"], 1, "Nobody confirmed that the flash is"),
    ],
)
def test_a_closed_stdin_is_at_its_end(
    arguments: list[str], code: int, said: str, tmp_path: Path
) -> None:
    program = [sys.executable, "-m", "service.cli", *arguments, "sim://studio?width=64&height=64"]
    done = subprocess.run(
        ["sh", "-c", 'exec "$@" <&-', "sh", *program],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    assert (done.returncode, said in done.stderr) == (code, True), done.stderr


def _sh(redirected: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command whose streams are redirected as a shell says."""
    return subprocess.run(
        [
            "sh",
            "-c",
            f'exec "$@" {redirected}',
            "sh",
            sys.executable,
            "-m",
            "service.cli",
            *arguments,
        ],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )


def test_what_is_said_beside_the_results_is_not_among_them_where_stderr_is_closed() -> None:
    done = _sh("2>&-", "report", "nowhere")
    assert (done.returncode, done.stdout) == (2, "")


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="the system has no full disk to print on"
)
def test_a_disk_that_is_too_full_for_what_is_printed_is_no_fault_of_the_program() -> None:
    done = _sh("> /dev/full", "--version")
    assert done.returncode == 1
    assert (
        done.stderr.startswith("A disk is full that this writes to")
        and done.stderr.count("\n") == 1
    )


@pytest.mark.parametrize("encoding", ["latin-1", "ascii", "iso8859-5:strict"])
def test_a_character_that_stdout_does_not_have_ends_no_command(encoding: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "service.cli", "separate", "--help"],
        env=os.environ | {"PYTHONIOENCODING": encoding},
        capture_output=True,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"X,Y,RADIUS|NAME|FILE" in done.stdout
