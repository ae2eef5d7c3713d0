from __future__ import annotations

import errno
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

import drivers
from drivers.ptp import usb as driver
from service import durable
from service.cli import run
from tests.unit.service.studio import take_release_away
from tests.unit.service.usb_bus import ADDRESS, Bus

CAMERA = "sim://studio?width=64&height=64"


@pytest.fixture(autouse=True)
def _deaf(monkeypatch: pytest.MonkeyPatch) -> None:
    """No cameras of the network that the tests run in."""
    monkeypatch.setattr(drivers, "listen_to_network", lambda: None)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def capture(*arguments: str) -> int:
    return run(["capture", *arguments])


def shots(out: Path) -> dict[str, list[str]]:
    """The files of a folder by shot, without its name."""
    found: dict[str, list[str]] = {}
    for path in sorted(out.iterdir()):
        shot, _, rest = path.name.partition("_")
        found.setdefault(shot, []).append(rest)
    return found


def refused(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 2) -> str:
    assert run(arguments) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    return said.err


def test_cameras_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["cameras"]) == 0
    (camera,) = drivers.list_cameras()
    line = capsys.readouterr().out
    assert line.startswith(f"sim://studio  {camera.make} {camera.model}")
    assert run(["cameras", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [asdict(camera) | {"unable": None}]


def test_a_camera_that_no_order_releases_is_listed_as_such(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("drivers.ptp.usb._libusb", lambda: Bus(away_for=0))
    assert run(["cameras"]) == 0
    usable = capsys.readouterr()
    assert f"{ADDRESS}  NIKON CORPORATION NIKON D5100, battery 87 %\n" in usable.out
    take_release_away(monkeypatch)
    assert run(["cameras"]) == 0
    said = capsys.readouterr().out.partition(ADDRESS)[2].splitlines()
    assert said[0] == "  NIKON CORPORATION NIKON D5100, battery 87 %"
    assert said[1].startswith("  The camera takes no order to release over PTP: have libgphoto2")
    assert run(["cameras", "--json"]) == 0
    (told,) = (one for one in json.loads(capsys.readouterr().out) if one["address"] == ADDRESS)
    assert told["unable"] == said[1].strip()


def test_a_camera_on_usb_that_does_not_open_is_listed_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def held(_address: str) -> None:
        raise drivers.CameraTimeoutError("It gave no answer.")

    monkeypatch.setattr("drivers.ptp.usb._libusb", lambda: Bus(away_for=0))
    monkeypatch.setattr("drivers.ptp.usb.open_camera", held)
    assert run(["cameras"]) == 0
    said = capsys.readouterr()
    assert f"{ADDRESS}  " in said.out
    assert said.err == f"{ADDRESS}: It gave no answer.\n"


@pytest.fixture
def simcam() -> Iterator[str]:
    served = drivers.serve_simulated(CAMERA, "127.0.0.1", 0)
    yield f"ptp+ip://{served.address}"
    served.close()


def test_cameras_of_the_network_that_the_operator_names_are_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], simcam: str
) -> None:
    named = f"sim:// ptp+ip:// {simcam} ptp+ip://127.0.0.1:9 gphoto2://ptpip:x"
    monkeypatch.setenv("LIGHTLAYERS_CAMERAS", named)
    assert run(["cameras"]) == 0
    said = capsys.readouterr()
    assert f"{simcam}  NIKON CORPORATION NIKON D5100, battery 87 %\n" in said.out
    assert said.err.startswith("No camera answers at 127.0.0.1:9")
    assert len(said.err.splitlines()) == 1


def test_a_pair_is_named_by_its_shot_and_keeps_both_kinds(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert capture(f"{CAMERA}&format=both", "-o", str(out)) == 0
    ((shot, names),) = shots(out).items()
    assert names == ["flash.dng", "flash.jpg", "no_flash.dng", "no_flash.jpg", "recipe.json"]
    told = capsys.readouterr().out.split()
    assert sorted(told) == [str(out / f"{shot}_{name}") for name in names[:-1]]
    dark, bright = ((out / f"{shot}_{name}.dng").read_bytes() for name in ("no_flash", "flash"))
    assert dark != bright
    assert (out / f"{shot}_flash.jpg").read_bytes()[:3] == b"\xff\xd8\xff"


def test_another_capture_into_the_same_folder_replaces_nothing(out: Path) -> None:
    for _ in range(2):
        assert capture(CAMERA, "-o", str(out)) == 0
    assert list(shots(out).values()) == [["flash.dng", "no_flash.dng", "recipe.json"]] * 2


def test_a_burst_takes_pairs_with_the_settings_that_were_set(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    burst = ("--pairs", "3", "--set", "iso=200", "--set", "shutter_s=1/100", "--json")
    assert capture(CAMERA, "-o", str(out), *burst) == 0
    told = json.loads(capsys.readouterr().out)["pairs"]
    assert [pair["shot"] for pair in told] == list(shots(out))
    assert len(told) == 3
    for pair in told:
        assert [Path(name).is_file() for name in pair["files"]] == [True, True]
        settings = json.loads(Path(pair["recipe"]).read_bytes())["settings"]
        assert settings["iso"] == 200
        assert settings["shutter_s"] == 0.01
        assert "flash" not in settings
    taken = {Path(pair["files"][0]).read_bytes() for pair in told}
    assert len(taken) == 3


def test_a_recipe_makes_another_pair_like_the_first(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = ("--set", "iso=400", "--set", "f_number=5.6", "--set", "white_balance=tungsten")
    assert capture(CAMERA, "-o", str(out), *first) == 0
    (recipe,) = out.glob("*_recipe.json")
    made = json.loads(recipe.read_bytes())
    assert made["camera"]["serial"] == "0000001"
    again = tmp_path / "again"
    assert capture(CAMERA, "-o", str(again), "--recipe", str(recipe), "--set", "iso=200") == 0
    (other,) = again.glob("*_recipe.json")
    settings = json.loads(other.read_bytes())["settings"]
    assert settings == {**made["settings"], "iso": 200}
    assert (settings["f_number"], settings["white_balance"]) == (5.6, "tungsten")
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "iso"], "--set iso: write NAME=VALUE"),
        (["--set", "colour=red"], "NAME is one of shutter_s, f_number, iso"),
        (["--set", "flash=fill"], "leave the setting flash out"),
        (["--set", "iso=auto"], "a fixed iso"),
        (["--set", "drive=burst"], "drive single"),
        (["--recipe", "nothing.json"], "The recipe nothing.json cannot be read"),
        (["--flash", "external"], "--flash external is neither property nor operator"),
        (["--pairs", "0"], "--pairs"),
        (["--interval", "-1"], "--interval"),
        (["--interval", "inf"], "--interval"),
        (["--settle", "inf"], "--settle"),
        (["--interval", "nan"], "--interval"),
        (["--settle", "nan"], "--settle"),
        (["--wait", "soon"], "--wait"),
        (["--wait", "nan"], "--wait"),
    ],
)
def test_what_cannot_be_asked_of_a_camera_is_told_before_it_is_opened(
    arguments: list[str], words: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in refused(capsys, "capture", CAMERA, "-o", str(out), *arguments)
    assert not out.exists()


@pytest.mark.parametrize(
    "value", ["inf", "nan", "1/0", "-5", "1e400", f"{10**400}/1", "77", "high"]
)
def test_values_that_the_camera_cannot_have_are_told(
    value: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = ("--set", f"iso={value}")
    said = refused(capsys, "capture", CAMERA, "-o", str(out), *wanted, code=1)
    assert "iso" in said
    assert not out.exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"settings": {"iso": true}}',
        '{"settings": {"colour": 1}}',
        '{"settings": {"shutter_s": NaN}}',
        '{"settings": {"shutter_s": 1e999}}',
        "\xff",
    ],
)
def test_a_file_that_is_no_recipe_is_told(
    text: str, tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.json").write_bytes(text.encode("latin-1"))
    said = refused(capsys, "capture", CAMERA, "-o", str(out), "--recipe", str(tmp_path / "r.json"))
    assert "r.json is no recipe" in said


def test_a_camera_that_fails_is_no_bad_input(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "capture", f"{CAMERA}&fault=store_full", "-o", str(out), code=1)
    assert "memory card is full" in said
    assert not out.exists()


def test_photographs_leave_the_card_only_once_they_are_on_the_disk(
    out: Path, simcam: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write = durable.write

    def full(path: Path, data: bytes) -> None:
        if path.name.endswith("_recipe.json"):
            raise OSError(28, "No space left on device")
        write(path, data)

    monkeypatch.setattr(durable, "write", full)
    assert "no space left" in refused(capsys, "capture", simcam, "-o", str(out), "--delete")
    with drivers.open_camera(simcam) as camera:
        assert len(camera.objects()) == 3  # with the folder
    monkeypatch.setattr(durable, "write", write)
    assert capture(simcam, "-o", str(out), "--delete") == 0
    with drivers.open_camera(simcam) as camera:
        assert len(camera.objects()) == 3
    assert list(shots(out).values()) == [["flash.dng", "no_flash.dng", "recipe.json"]]


def test_photographs_stay_on_the_card_while_their_names_may_be_lost(
    out: Path, simcam: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_path: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "flush", fail)
    assert "no space left" in refused(capsys, "capture", simcam, "-o", str(out), "--delete")
    with drivers.open_camera(simcam) as camera:
        assert len(camera.objects()) == 3  # with the folder


def test_a_camera_that_answers_nothing_is_waited_for_once(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    waits = list[float]()

    def silent(_camera: drivers.ReturningCamera, wait_s: float) -> drivers.Camera:
        waits.append(wait_s)
        raise drivers.CameraTimeoutError("The camera gave no answer.")

    monkeypatch.setattr(drivers.ReturningCamera, "connected", silent)
    said = refused(capsys, "capture", "ptp+ip://studio", "-o", str(out), "--wait", "60", code=1)
    assert said == "The camera gave no answer.\n"
    assert waits == [60]


@pytest.fixture
def strange(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many more pairs are broken by an answer that is not valid."""
    left, capture_pair = [0], drivers.capture_pair

    def garbled(camera: drivers.Camera, **how: Any) -> drivers.CapturedPair:
        if left[0]:
            left[0] -= 1
            raise drivers.ProtocolError("The camera answers nonsense")
        return capture_pair(camera, **how)

    monkeypatch.setattr(drivers, "capture_pair", garbled)
    return left


STRANGE = (
    "The camera answers nonsense: switch the camera off and on, connect it anew and try again."
)


def test_with_a_wait_a_pair_with_a_strange_answer_is_taken_anew(
    out: Path, strange: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    strange[0] = 2
    assert capture(CAMERA, "-o", str(out), "--wait", "60") == 0
    assert len(shots(out)) == 1
    said = capsys.readouterr().err.splitlines()
    assert said == [f"{STRANGE} The whole pair is taken anew."] * 2


def test_after_three_pairs_with_strange_answers_the_camera_is_given_up(
    out: Path, strange: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    strange[0] = 4
    assert capture(CAMERA, "-o", str(out), "--wait", "60") == 1
    assert capsys.readouterr().err.splitlines()[-1] == STRANGE
    assert strange == [1]
    assert not out.exists()


def test_without_a_wait_a_strange_answer_ends_the_command(
    out: Path, strange: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    strange[0] = 1
    assert refused(capsys, "capture", CAMERA, "-o", str(out), code=1) == f"{STRANGE}\n"


class TestUnplugged:
    """A USB camera whose cable comes out in the middle of a transfer."""

    @pytest.fixture
    def bus(self, monkeypatch: pytest.MonkeyPatch) -> Bus:
        bus = Bus(away_for=3)
        monkeypatch.setattr(driver, "_libusb", lambda: bus)
        return bus

    def test_the_command_fails_and_the_next_works_at_another_address(
        self, bus: Bus, out: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        bus.body.fault = "unplug"
        said = refused(capsys, "capture", ADDRESS, "-o", str(out), code=1)
        assert said.startswith("The connection to the camera broke: plug it in again")
        assert not out.exists()
        assert bus.away_for == 3
        assert "0000001 is on USB" in refused(capsys, "capture", ADDRESS, "-o", str(out))
        bus.replug()
        bus.body.fault = "none"
        assert capture(ADDRESS, "-o", str(out)) == 0
        assert list(shots(out).values()) == [["flash.jpg", "no_flash.jpg", "recipe.json"]]
        assert bus.address == 2

    @pytest.fixture
    def _after_the_pair(self, bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
        capture_pair = drivers.capture_pair

        def unplugged(camera: drivers.Camera, **how: Any) -> drivers.CapturedPair:
            pair = capture_pair(camera, **how)
            bus._responder.unplugged = True
            return pair

        monkeypatch.setattr(drivers, "capture_pair", unplugged)

    @pytest.mark.usefixtures("_after_the_pair")
    def test_a_pair_that_is_here_already_is_kept(self, out: Path) -> None:
        assert capture(ADDRESS, "-o", str(out)) == 0
        ((_, names),) = shots(out).items()
        assert names == ["flash.jpg", "no_flash.jpg", "recipe.json"]
        (recipe,) = out.glob("*_recipe.json")
        assert json.loads(recipe.read_bytes())["camera"]["serial"] == "0000001"

    @pytest.mark.usefixtures("_after_the_pair")
    def test_a_pair_that_cannot_be_deleted_is_told_as_saved(
        self, bus: Bus, out: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        bus.away_for = 0  # back at once, where other photographs may have these numbers
        assert capture(ADDRESS, "-o", str(out), "--delete") == 1
        said = capsys.readouterr()
        assert said.out.splitlines() == [str(path) for path in sorted(out.glob("*.jpg"))][::-1]
        assert said.err.startswith("The pair is saved, but could not be taken off the camera's")
        assert len(said.err.splitlines()) == 1
        assert len(bus.body.objects) == 3  # with the folder

    def test_with_a_wait_the_whole_pair_is_taken_anew(
        self, bus: Bus, out: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        bus.body.fault = "unplug"
        assert capture(ADDRESS, "-o", str(out), "--pairs", "2", "--wait", "60") == 0
        assert bus.address == 2
        assert list(shots(out).values()) == [["flash.jpg", "no_flash.jpg", "recipe.json"]] * 2
        said = capsys.readouterr().err.splitlines()
        assert said[0].endswith("The whole pair is taken anew.")
        assert said[1].endswith("It is waited for.")
        assert said[2] == "The camera is there."
        files = {path.read_bytes() for path in out.glob("*.jpg")}
        stored = {bytes(each.data) for each in bus.body.objects.values()}
        assert len(files) == 4
        assert files < stored  # and none of the broken pair, which is on the card alone

    def test_it_is_waited_for_at_the_start(self, bus: Bus, out: Path) -> None:
        bus._responder.unplugged = True
        assert capture(ADDRESS, "-o", str(out), "--wait", "60") == 0
        assert len(shots(out)) == 1

    def test_a_camera_that_keeps_breaking_off_is_given_up(
        self, bus: Bus, out: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        replugs: list[int] = []

        def replug() -> None:
            Bus.replug(bus)
            replugs.append(bus.away_for)
            bus.body.fault, bus.away_for = "unplug", 1

        bus.body.fault, bus.away_for = "unplug", 1
        monkeypatch.setattr(bus, "replug", replug)
        assert capture(ADDRESS, "-o", str(out), "--wait", "60") == 1
        assert len(replugs) == 2
        assert not out.exists()


def test_the_service_lists_what_was_heard_and_waits_for_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from drivers.ptp import ip

    heard: dict[str, Any] = {
        "x": drivers.CameraInfo("ptp+ip://192.0.2.7", "", "Studio camera", "", None)
    }
    monkeypatch.setattr(ip, "ANNOUNCED", heard)
    assert drivers.CameraInfo("ptp+ip://192.0.2.7", "", "Studio camera", "", None) in (
        drivers.list_cameras()
    )


def test_a_pair_for_which_there_is_no_room_is_told_with_where_it_is_left(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("service.durable.write", full)
    assert refused(capsys, "capture", CAMERA, "-o", str(out)) == (
        f"The folder {out} cannot be written: no space left on device. See to it and its disk: the "
        "pair is on the camera's card alone.\n"
    )
    assert not out.exists()
