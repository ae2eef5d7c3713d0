from __future__ import annotations

import errno
import json
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest

import drivers
from drivers.errors import ProtocolError
from drivers.ptp.camera import PtpCamera
from pipeline.errors import UnreadableImageError
from service.sending import sender
from service.sending.spool import Spool, SpooledPair
from service.workers import camera_tasks
from tests.unit.service.usb_bus import Bus

AWAY = "http://127.0.0.1:9"


def told(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def left_in(spool: Path) -> str:
    return f"Pairs in the spool {spool}, which the next start with it sends"


def jobs_of(http: httpx.Client) -> list[dict[str, Any]]:
    """Every job, the oldest first."""
    found: list[dict[str, Any]] = http.get("/jobs").raise_for_status().json()["jobs"]
    return found[::-1]


def test_each_press_of_enter_sends_a_pair(
    tether: Callable[..., int],
    http: httpx.Client,
    waiting: Callable[[], int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "options.json").write_text('{"lights": 2}')
    options = ("--options", str(tmp_path / "options.json"), "--set", "iso=200")
    assert tether(*options, lines="\n\n") == 0
    found = jobs_of(http)
    assert [job["options"] for job in found] == [{"lights": 2}] * 2
    said = capsys.readouterr()
    assert [line.partition(": ")[2] for line in said.out.splitlines() if "job" in line] == [
        f"job {job['id']}" for job in found
    ]
    assert said.err.count("Press Enter to take a pair.") == 3
    assert waiting() == 0


def test_programs_are_told_in_lines_of_json(
    tether: Callable[..., int], http: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tether("--pairs", "2", "--interval", "0", "--json") == 0
    events = told(capsys)
    jobs = jobs_of(http)
    spooled = [event for event in events if event["event"] == "spooled"]
    sent = [event for event in events if event["event"] == "sent"]
    assert [event["shot"] for event in spooled] == [event["shot"] for event in sent]
    assert [event["job"] for event in sent] == [job["id"] for job in jobs]
    assert [event["sha256"] for event in spooled] == [
        {frame: file["sha256"] for frame, file in job["inputs"].items()} for job in jobs
    ]


def test_a_program_is_told_of_each_line_that_is_waited_for(
    tether: Callable[..., int],
    http: httpx.Client,
    bus: Bus,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    brightness = [2.0, 1.0]
    decoded = SimpleNamespace(pixels=np.array([0.0]))
    monkeypatch.setattr(camera_tasks, "decode", lambda _photograph: decoded)
    monkeypatch.setattr(camera_tasks, "brightness", lambda _photograph: brightness.pop())
    bus.body.flash = "external"
    assert tether("--flash", "operator", "--json", "--pairs", "1", lines="\n\n\n") == 0
    asked = [(event["event"], event["detail"]) for event in told(capsys)][:3]
    assert asked == [
        ("ready", "Press Enter to take a pair."),
        ("operator", "Switch the flash off, then press Enter."),
        ("operator", "Switch the flash on, then press Enter."),
    ]
    assert len(jobs_of(http)) == 1


def test_it_captures_while_the_service_is_away_and_the_next_start_sends(
    tether: Callable[..., int],
    http: httpx.Client,
    folder: Path,
    waiting: Callable[[], int],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupted(_sender: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(sender.Sender, "finish", interrupted)
        assert tether("--pairs", "3", "--interval", "0", "--json", server=AWAY) == 130
    events = told(capsys)
    assert [event["event"] for event in events].count("spooled") == 3
    assert [event["event"] for event in events].count("held") == 1
    assert events[-1]["detail"] == f"{left_in(folder)}: 3."
    assert (waiting(), jobs_of(http)) == (3, [])
    assert tether("--pairs", "0", "--json") == 0
    sent = [event["shot"] for event in told(capsys)]
    assert sent == [event["shot"] for event in events if event["event"] == "spooled"]
    assert (waiting(), len(jobs_of(http))) == (0, 3)


def test_unplugged_in_a_transfer_the_press_fails_and_the_next_works_without_a_restart(
    tether: Callable[..., int],
    http: httpx.Client,
    bus: Bus,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bus.body.fault = "unplug"
    assert tether("--json", lines="\n\n") == 1
    events = told(capsys)
    assert [event["event"] for event in events] == [
        *("ready", "failed", "camera", "camera", "ready", "spooled"),
        *[event["event"] for event in events[6:]],
    ]
    assert sorted(event["event"] for event in events[6:]) == ["ready", "sent"]
    assert "plug it in again" in events[1]["detail"]
    assert events[2]["detail"].endswith("It is waited for.")
    assert events[3]["detail"] == "The camera is there."
    assert bus.address == 2
    assert len(jobs_of(http)) == 1


def test_the_end_of_stdin_ends_it_also_while_the_camera_is_away(
    tether: Callable[..., int], bus: Bus, capsys: pytest.CaptureFixture[str]
) -> None:
    bus.enumerate_devices = lambda: iter(())  # type: ignore[method-assign]
    assert tether("--json", lines="") == 0
    (event,) = told(capsys)
    assert (event["event"], event["detail"].endswith("It is waited for.")) == ("camera", True)


def test_at_intervals_it_goes_on_once_the_camera_is_back(
    tether: Callable[..., int], http: httpx.Client, bus: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.cli.taking._PAUSE_S", 0.01)
    bus.body.fault = "unplug"
    assert tether("--interval", "0", "--pairs", "3") == 1  # one of them has failed
    assert len(jobs_of(http)) == 2


def test_a_strange_answer_of_the_camera_is_waited_out(
    tether: Callable[..., int],
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    info, errors = PtpCamera.info, [ProtocolError("Strange")] * 2

    def strange(camera: PtpCamera) -> drivers.CameraInfo:
        if errors:
            raise errors.pop()
        return info(camera)

    monkeypatch.setattr(PtpCamera, "info", strange)
    assert tether("--interval", "0", "--pairs", "1", "--json") == 0
    assert [event["detail"] for event in told(capsys) if event["event"] == "camera"] == [
        f"{ProtocolError('Strange')} It is waited for.",
        "The camera is there.",
    ]
    assert len(jobs_of(http)) == 1


@pytest.mark.parametrize(("broken", "ended"), [([], [1]), ([OSError(5, "broken")], [])])
def test_whatever_ends_it_what_waits_in_the_spool_is_told(
    tether: Callable[..., int],
    broken: list[OSError],
    ended: list[int],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    count = Spool.count

    def counted(spool: Spool) -> int:
        if broken:
            raise broken[0]
        return count(spool)

    def fails(_sender: object) -> None:
        monkeypatch.setattr(Spool, "count", counted)
        raise RuntimeError("the cause")

    monkeypatch.setattr(sender.Sender, "finish", fails)
    assert tether("--pairs", "1", "--interval", "0", "--json", server=AWAY) == 1
    said = capsys.readouterr()
    events = [json.loads(line) for line in said.out.splitlines()]
    assert [event["waiting"] for event in events if event["event"] == "ended"] == ended
    assert "RuntimeError" in said.err and "the cause" in said.err


def test_pairs_that_are_left_in_the_spool_are_a_failure_that_is_told(
    tether: Callable[..., int],
    folder: Path,
    waiting: Callable[[], int],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    finish = sender.Sender.finish

    def stopped(sending: sender.Sender) -> bool:
        sending.stop()
        return finish(sending)

    monkeypatch.setattr(sender.Sender, "finish", stopped)
    assert tether("--pairs", "1", "--interval", "0", "--json", server=AWAY) == 1
    assert told(capsys)[-1] == {
        "event": "ended",
        "detail": f"{left_in(folder)}: 1.",
        "waiting": 1,
        "spool": str(folder),
    }
    assert waiting() == 1


def test_it_ends_in_silence_where_nobody_reads_what_it_tells(
    tether: Callable[..., int],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def unheard(*_: object, **_layout: object) -> None:
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("service.cli.display.print_json", unheard)
    for stream in ("stdout", "stderr"):  # typer covers them for the rest of the process
        monkeypatch.setattr(f"sys.{stream}", getattr(sys, stream))
    with pytest.raises(SystemExit) as ended:
        tether("--json", lines="\n", server=AWAY)
    assert (ended.value.code, capsys.readouterr().err) == (1, "")


def test_a_photograph_that_cannot_be_decoded_fails_its_pair_alone(
    tether: Callable[..., int],
    http: httpx.Client,
    bus: Bus,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused, brightness = [UnreadableImageError("Not a kind that is read.")], [2.0, 1.0]

    def decode(_photograph: bytes) -> SimpleNamespace:
        if refused:
            raise refused.pop()
        return SimpleNamespace(pixels=np.array([brightness.pop()]))

    monkeypatch.setattr(camera_tasks, "decode", decode)
    bus.body.flash = "external"
    assert tether("--flash", "true {state}", "--settle", "0", "--json", lines="\n\n") == 1
    events = told(capsys)
    assert [event["detail"] for event in events if event["event"] == "failed"] == [
        "Not a kind that is read."
    ]
    assert [event["event"] for event in events].count("spooled") == len(jobs_of(http)) == 1


def test_a_disk_without_room_is_told_and_the_card_has_the_pair(
    tether: Callable[..., int],
    bus: Bus,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Spool, "add", full)
    assert tether(lines="\n") == 1
    said = capsys.readouterr().err
    assert (
        "cannot be written: no space left on device. See to the folder and its disk: the pair is "
        "on the camera's card alone.\n"
    ) in said
    assert f"The spool {tmp_path}" in said
    assert len(bus.body.objects) == 3  # with the folder


def test_a_pair_that_a_failing_disk_may_lose_is_told_to_wait_and_is_sent(
    tether: Callable[..., int],
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    add = Spool.add

    def doubted(spool: Spool, *pair: Any) -> SpooledPair:
        return replace(add(spool, *pair), doubt="input/output error")

    monkeypatch.setattr(Spool, "add", doubted)
    assert tether("--pairs", "1", "--interval", "0", "--json") == 0
    (spooled,) = (event for event in told(capsys) if event["event"] == "spooled")
    assert spooled["detail"] == (
        f"{spooled['shot']}: in the spool, but its disk fails: input/output error. Keep the "
        "camera's card until the pair is sent, and check the disk."
    )
    assert len(jobs_of(http)) == 1


def test_a_pair_in_a_spool_that_cannot_be_read_just_then_is_still_sent(
    tether: Callable[..., int],
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    count = Spool.count

    def counted(spool: Spool) -> int:
        if threading.current_thread() is threading.main_thread():
            raise OSError(5, "Input/output error")
        return count(spool)

    monkeypatch.setattr(Spool, "count", counted)
    assert tether("--pairs", "1", "--interval", "0", "--json") == 0
    (spooled,) = (event for event in told(capsys) if event["event"] == "spooled")
    assert spooled.keys() == {"event", "detail", "shot", "sha256"}
    assert len(jobs_of(http)) == 1


def test_a_pair_that_the_service_refuses_for_good_ends_as_a_failure(
    tether: Callable[..., int],
    http: httpx.Client,
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "options.json").write_text('{"flash_spectrum": {"calibration": "nothing"}}')
    assert tether("--options", str(tmp_path / "options.json"), lines="\n") == 1
    said = capsys.readouterr().err
    assert "there is no calibration 'nothing'" in said
    (aside,) = (folder / "aside").iterdir()
    assert f"put aside in {aside}" in said
    assert jobs_of(http) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--server", "photos"], "http://"),
        (["--camera", "ptp+usb://a b"], "ptp+usb://"),
        (["--camera", "sim://garden"], "sim://studio"),
        (["--options", "nothing.json"], "nothing.json cannot be read"),
        (["--options", __file__], "no JSON"),
        (["--interval", "-1"], "--interval"),
        (["--interval", "inf"], "--interval"),
        (["--interval", "nan"], "--interval"),
        (["--pairs", "-1"], "--pairs"),
        (["--set", "iso=auto"], "a fixed iso"),
        (["--flash", "relay on"], "write {state} where on or off is to stand"),
        (["--flash", "relay '{state}"], "cannot be read (no closing quotation)"),
        (["--key-file", "nothing.key"], "nothing.key cannot be read"),
        (["--key", "ll_abc"], "No such option"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(
    tether: Callable[..., int],
    arguments: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tether(*arguments) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"lights": 7}', ": lights: more than three lamps"),
        ('{"exposure_ratio": "1.5"}', ": exposure_ratio: Input should be a valid number."),
        ('{"flash_only": 1}', ": flash_only: Input should be a valid boolean."),
        ('{"colour": 1}', ": colour: this name is not known."),
        ('{"camra": {"calibration": "a"}}', ": camra: this name is not known."),
        ('{"lights": {"calibration": "a"}}', ": lights: Input should be"),
        ("[" * 100_000, "is no JSON"),
        ("[]", "is no JSON object"),
        ("3", "is no JSON object"),
    ],
)
def test_options_that_no_job_can_have_are_told_before_a_pair_is_taken(
    tether: Callable[..., int],
    text: str,
    words: str,
    tmp_path: Path,
    bus: Bus,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "options.json"
    file.write_text(text)
    assert tether("--options", str(file), lines="\n") == 2
    said = capsys.readouterr().err
    assert said.startswith(f"The file of options {file}")
    assert words in said
    assert len(bus.body.objects) == 1


def test_options_may_ask_for_what_a_calibration_brings(
    tether: Callable[..., int], tmp_path: Path
) -> None:
    file = tmp_path / "options.json"
    file.write_text('{"response": {"calibration": "a"}, "outputs": ["response.jpg"]}')
    assert tether("--options", str(file), "--pairs", "0") == 0


def test_a_spool_in_use_is_told(
    tether: Callable[..., int], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spool = Spool(folder)
    assert tether(lines="\n") == 2
    assert "in use by another agent" in capsys.readouterr().err
    spool.close()
