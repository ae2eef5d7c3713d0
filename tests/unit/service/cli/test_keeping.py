from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import InputError
from pipeline.options import DirectedLight
from service import durable
from service.cli.keeping import folder, keep, kept_for

CONTENT = b'{"lights": [{"direction": [0, 0, 1]}]}'
MARKS = b"a picture"
TAKEN = {
    "make": "NIKON",
    "model": "D5100 / b",
    "body": "",
    "rendered": False,
    "encoding": "raw",
    "upright": False,
    "orientation": 1,
}


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_CALIBRATIONS_DIR", str(tmp_path / "kept"))


def _manifest(**more: Any) -> dict[str, Any]:
    return {"taken_with": {**TAKEN, **more}}


def test_what_is_kept_is_given_back(tmp_path: Path) -> None:
    path = keep("lamps", "table", _manifest(), CONTENT, MARKS)
    assert path == tmp_path / "kept" / "table" / "lamps_NIKON_D5100---b.json"
    (one,) = kept_for("table")
    assert (one.kind, one.setup, one.name) == ("lamps", "table", path.name)
    assert one.taken_with.model_dump() == TAKEN
    assert one.value() == [DirectedLight(direction=(0, 0, 1))]
    assert one.made.endswith("+00:00")
    assert kept_for("default") == []


@pytest.mark.parametrize("ending", ["json", "jpg"])
def test_on_a_full_disk_what_was_kept_before_still_is(
    monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    keep("lamps", "table", _manifest(), CONTENT, MARKS)
    write = durable.write

    def write_some(path: Path, data: bytes) -> None:
        full = path.suffixes[-2:] == [f".{ending}", ".new"]
        write(path, data[:5] if full else data)
        if full:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "write", write_some)
    with pytest.raises(InputError, match="cannot be written: no space left on device"):
        keep("lamps", "table", _manifest(), b'{"lights": []}', b"another picture")
    assert [one.content for one in kept_for("table")] == [CONTENT.decode()]


def test_one_of_the_same_camera_is_replaced() -> None:
    keep("lamps", "table", _manifest(), b'{"lights": []}', MARKS)
    keep("lamps", "table", _manifest(), CONTENT, MARKS)
    assert [one.content for one in kept_for("table")] == [CONTENT.decode()]


@pytest.mark.parametrize(
    "other",
    [
        {"model": "D850"},
        {"body": "0123456789ab"},
        {"rendered": True, "encoding": "srgb"},
        {"encoding": "linear"},
        {"upright": True},
        {"orientation": 3},
    ],
)
def test_other_cameras_and_renderings_are_kept_beside_it(other: dict[str, Any]) -> None:
    keep("lamps", "table", _manifest(), CONTENT, MARKS)
    keep("lamps", "table", _manifest(**other), CONTENT, MARKS)
    assert len(kept_for("table")) == 2


def test_a_flash_is_the_same_whatever_the_files_hold_and_however_they_lie() -> None:
    for encoding in ("raw", "linear"):
        manifest = _manifest(encoding=encoding, upright=encoding == "linear")
        manifest["taken_with"]["orientation"] = 6 if encoding == "linear" else 1
        keep("flash", "table", manifest, CONTENT, MARKS)
    assert [one.taken_with.encoding for one in kept_for("table")] == ["linear"]


def test_what_was_kept_before_files_were_noted_is_read() -> None:
    path = keep("lamps", "table", _manifest(), CONTENT, MARKS)
    said = json.loads(path.read_bytes())
    for name in ("encoding", "upright", "orientation"):
        del said["taken_with"][name]
    path.write_text(json.dumps(said))
    (one,) = kept_for("table")
    assert (one.taken_with.encoding, one.taken_with.upright) == ("", None)
    assert one.taken_with.orientation is None


def test_without_a_setting_it_is_the_users_own_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("LIGHTLAYERS_CALIBRATIONS_DIR")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    assert folder().is_relative_to(tmp_path)
    assert folder().parts[-2:] == ("lightlayers", "calibrations")


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("a file")
    with pytest.raises(InputError, match=r"lamps_.*json cannot be written: "):
        keep("lamps", "table", _manifest(), CONTENT, MARKS)


@pytest.mark.parametrize("content", ["", "{}", '{"kind": "lamps"}', "\xff"])
def test_a_spoilt_file_is_said(content: str) -> None:
    path = keep("lamps", "table", _manifest(), CONTENT, MARKS)
    path.write_text(content)
    with pytest.raises(InputError, match=r"lamps_.* cannot be read: calibrate anew, or remove it"):
        kept_for("table")


def test_a_field_of_another_version_is_said() -> None:
    path = keep("lamps", "table", _manifest(), CONTENT, MARKS)
    path.write_text(json.dumps({**json.loads(path.read_text()), "new": 1}))
    with pytest.raises(InputError, match="calibrate anew"):
        kept_for("table")
