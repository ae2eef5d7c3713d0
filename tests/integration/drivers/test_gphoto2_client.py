"""libgphoto2, in Debian's gphoto2 and in PyPI's, as a client of our simulated camera."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import drivers
from drivers.clock import SystemClock
from drivers.exif import read_exposure
from drivers.ptp.codes import EventCode, ObjectFormat
from drivers.sim.address import parse
from drivers.sim.body import Body, StoredObject
from drivers.sim.ip_responder import IpResponder

Client = Callable[..., str]


@pytest.fixture
def client(camera: Any, run: Callable[..., str], tmp_path: Path) -> Client:
    port = f"ptpip:127.0.0.1:{camera.port}:{camera.port}"
    return lambda *arguments: run("gphoto2", "--port", port, *arguments, cwd=tmp_path)


def test_the_summary_names_the_camera(client: Client) -> None:
    told = client("--summary")
    assert "Model: NIKON D5100" in told
    assert "Flash Mode(0x500c):(readwrite)" in told
    assert "Free Space (Images):" in told


def test_settings_are_listed_and_set(client: Client) -> None:
    assert "/main/capturesettings/flashmode" in client("--list-config")
    for value in ("Flash off", "Fill flash"):
        client("--set-config-value", f"flashmode={value}")
        assert f"Current: {value}" in client("--get-config", "flashmode")


def test_both_photographs_are_taken_and_downloaded(client: Client, tmp_path: Path) -> None:
    pair = []
    for value in ("Flash off", "Fill flash"):
        client("--set-config-value", f"flashmode={value}", "--capture-image-and-download")
        (photograph,) = tmp_path.iterdir()
        pair.append(photograph.read_bytes())
        photograph.unlink()
    check_pair(*pair)


def check_pair(no_flash: bytes, flash: bytes) -> None:
    """The flash alone differs."""
    without, with_flash = read_exposure(no_flash), read_exposure(flash)
    assert without == replace(with_flash, flash_fired=False)
    assert with_flash.flash_fired


def test_a_pair_is_triggered_and_fetched_on_events(client: Client, tmp_path: Path) -> None:
    pair = []
    for value in ("Flash off", "Fill flash"):
        client("--set-config-value", f"flashmode={value}")
        # The flash of the test before is recharged in a second, which gphoto2 does not wait for.
        client(
            *("--wait-event=2s", "--trigger-capture"),
            "--wait-event-and-download=CAPTURECOMPLETE",
        )
        assert {path.suffix for path in tmp_path.iterdir()} == {".DNG", ".JPG"}
        pair.append(next(tmp_path.glob("*.DNG")).read_bytes())
        for path in tmp_path.iterdir():
            path.unlink()
    check_pair(*pair)


def test_tethered_photographs_are_watched_for(client: Client, tmp_path: Path) -> None:
    client("--set-config-value", "flashmode=Flash off")
    told = client("--trigger-capture", "--capture-tethered=CAPTURECOMPLETE")
    assert "CAPTURECOMPLETE" in told
    assert {path.suffix for path in tmp_path.iterdir()} == {".DNG", ".JPG"}


def test_files_on_the_card_are_listed_and_fetched(
    client: Client, camera: Any, tmp_path: Path
) -> None:
    with drivers.open_camera(camera.address) as opened:
        pair = drivers.capture_pair(opened)
        described = pair.flash.stored
    folder = next(
        line.split("'")[1] for line in client("--list-files").splitlines() if "100STUDI" in line
    )
    for item in described:
        client("--folder", folder, "--get-file", item.name)
        assert (tmp_path / item.name).read_bytes() == pair.flash.files[item.kind]


def test_the_library_of_pypi_takes_a_pair(
    camera: Any, run: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    port = f"ptpip:127.0.0.1:{camera.port}:{camera.port}"
    run(sys.executable, "-m", "tests.pypi_gphoto2", port, cwd=tmp_path)
    check_pair(*((tmp_path / name).read_bytes() for name in ("no_flash", "flash")))


def test_our_driver_of_libgphoto2_takes_a_pair(camera: Any) -> None:
    with drivers.open_camera(f"gphoto2://ptpip:127.0.0.1:{camera.port}:{camera.port}") as opened:
        assert opened.info().model == "NIKON D5100"
        for value, taken in ((0.0101, 0.01), (0.0201, 0.02)):  # as cameras round them
            assert opened.write(drivers.SettingName.SHUTTER_S, value).value == taken
        pair = drivers.capture_pair(opened)
    assert [shot.exposure.flash_fired for shot in (pair.no_flash, pair.flash)] == [False, True]
    assert pair.flash.files.keys() == {"dng", "jpeg"}


class LateRaw(Body):
    """Its RAW files reach the card, and are told of, 0.2 s after their photograph is complete."""

    def __init__(self) -> None:
        super().__init__(parse("sim://studio?width=64&height=64&format=both"), SystemClock())
        self._held: dict[int, tuple[float, StoredObject]] = {}
        self._seen = set[int]()

    def advance(self) -> None:
        super().advance()
        now = self._clock.monotonic()
        for handle in self.objects.keys() - self._seen:
            self._seen.add(handle)
            if self.objects[handle].info.format is ObjectFormat.DNG:
                self._held[handle] = (now + 0.2, self.objects.pop(handle))
                self.events.remove((EventCode.OBJECT_ADDED, handle))
        for handle, (due, stored) in list(self._held.items()):
            if due <= now:
                del self._held[handle]
                self.objects[handle] = stored
                self.events.append((EventCode.OBJECT_ADDED, handle))

    def seconds_to_wait(self) -> float | None:
        for due, _ in self._held.values():
            return max(0.0, due - self._clock.monotonic())
        return super().seconds_to_wait()


@pytest.mark.parametrize("backend", ["ptp+ip://", "gphoto2://ptpip:"])
def test_a_raw_file_that_comes_after_its_photograph_was_called_complete_is_waited_for(
    backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.shot.SETTLE_S", 1.0)  # so that a slow machine is none too late
    served = IpResponder(LateRaw(), "127.0.0.1", 0)
    port = served.address.rpartition(":")[2]
    again = f":{port}" if backend.startswith("gphoto2") else ""
    with drivers.open_camera(f"{backend}{served.address}{again}") as opened:
        pair = drivers.capture_pair(opened)
    served.close()
    assert [shot.exposure.flash_fired for shot in (pair.no_flash, pair.flash)] == [False, True]
    for shot in (pair.no_flash, pair.flash):
        assert shot.files.keys() == {"dng", "jpeg"}
        assert read_exposure(shot.files["dng"]) == read_exposure(shot.files["jpeg"])


def test_a_session_has_no_malformed_packet(
    camera: Any, run: Callable[..., str], lacking: Callable[[str], None], tmp_path: Path
) -> None:
    recording = tmp_path / "session.pcapng"
    command = ["dumpcap", "-i", "lo", "-f", f"tcp port {camera.port}", "-w", str(recording)]
    try:
        recorder = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    except FileNotFoundError:
        lacking("tshark")
    assert recorder.stderr is not None
    told = recorder.stderr.readline()
    while told and "File:" not in told:
        told = recorder.stderr.readline()
    if not told:
        recorder.wait()
        lacking("the right to record packets")
    with drivers.open_camera(camera.address) as opened:
        drivers.capture_pair(opened)
    port = f"ptpip:127.0.0.1:{camera.port}:{camera.port}"
    off = ("--set-config-value", "flashmode=Flash off", "--capture-image-and-download")
    run("gphoto2", "--port", port, *off, cwd=tmp_path)
    decode = ("tshark", "-r", str(recording), "-d", f"tcp.port=={camera.port},ptpip", "-Y")
    packets = 0
    while packets < 200:  # the recorder still writes what the kernel holds of the sessions
        done = subprocess.run([*decode, "ptpip"], capture_output=True, text=True, check=False)
        packets = done.stdout.count("\n")
    recorder.terminate()
    recorder.communicate()
    decoded = run(*decode, "ptpip")
    assert run(*decode, "_ws.malformed") == ""
    for message in ("Init Command Request", "Init Event Ack", "Start Data", "Event"):
        assert message in decoded
