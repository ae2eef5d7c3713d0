from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.errors import InputError
from service import durable
from service.sending.spool import DamagedPairError, Spool, SpooledPair

PAIR = {"no_flash": ("dng", b"dark"), "flash": ("dng", b"bright")}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "spool"


@pytest.fixture
def spool(folder: Path) -> Iterator[Spool]:
    spool = Spool(folder)
    yield spool
    spool.close()


def shots(spool: Spool) -> list[str]:
    """Empty the spool; what was in it, in order."""
    found = []
    while pair := spool.first():
        found.append(pair.shot)
        spool.remove(pair)
    return found


def test_a_pair_is_kept_as_it_was_given(spool: Spool, folder: Path) -> None:
    added = spool.add("shot", PAIR, {"lights": 2})
    (place,) = (folder / "waiting").iterdir()
    assert place.name == "000001-shot"
    assert sorted(path.name for path in place.iterdir()) == [
        "flash.dng",
        "no_flash.dng",
        "pair.json",
    ]
    found = spool.first()
    assert found == added
    assert found is not None
    assert (found.about.options, found.damage()) == ({"lights": 2}, None)
    assert found.path("flash").read_bytes() == b"bright"
    assert found.sha256 == {
        frame: hashlib.sha256(data).hexdigest() for frame, (_, data) in PAIR.items()
    }


def test_photographs_in_it_are_nobody_elses_to_read(spool: Spool, folder: Path) -> None:
    spool.put_aside(spool.add("shot", PAIR, {}), "no pair")
    for name in ("waiting", "aside"):
        assert (folder / name).stat().st_mode & 0o777 == 0o700


def test_pairs_come_out_in_order_though_the_clock_was_set_back(spool: Spool, folder: Path) -> None:
    names = ["20260101T000000-000Z", "20250101T000000-000Z", "20270101T000000-000Z"]
    for name in names:
        spool.add(name, PAIR, {})
    first = spool.first()
    assert first is not None
    spool.remove(first)
    spool.close()
    spool = Spool(folder)
    spool.add("20200101T000000-000Z", PAIR, {})
    assert spool.count() == 3
    assert shots(spool) == [*names[1:], "20200101T000000-000Z"]
    assert list((folder / "waiting").iterdir()) == []
    spool.close()


def test_every_pair_has_a_key_of_its_own(spool: Spool) -> None:
    keys = {spool.add("shot", PAIR, {}).about.id for _ in range(3)}
    assert {len(key) for key in keys} == {32}
    assert len(keys) == 3


def test_one_agent_uses_it_at_a_time(spool: Spool, folder: Path) -> None:
    with pytest.raises(InputError, match="in use by another agent"):
        Spool(folder)
    spool.close()
    Spool(folder).close()


def test_a_folder_that_cannot_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match=r"cannot be used: not a directory\."):
        Spool(tmp_path / "file" / "spool")


def test_what_a_killed_process_left_is_no_pair(folder: Path) -> None:
    spool = Spool(folder)
    spool.add("whole", PAIR, {})
    half = folder / "waiting" / ".partial-x"
    half.mkdir()
    (half / "flash.dng").write_bytes(b"bri")
    (folder / "waiting" / ".DS_Store").write_bytes(b"")
    assert spool.count() == 1
    spool.close()
    spool = Spool(folder)
    assert not half.exists()
    assert shots(spool) == ["whole"]
    spool.close()


@pytest.mark.parametrize("fails_at", ["no_flash.dng", "flash.dng", "pair.json"])
def test_a_full_disk_leaves_nothing_half(
    spool: Spool, folder: Path, monkeypatch: pytest.MonkeyPatch, fails_at: str
) -> None:
    def write(path: Path, data: bytes) -> None:
        if path.name == fails_at:
            raise OSError(28, "No space left on device")
        path.write_bytes(data)

    monkeypatch.setattr(durable, "write", write)
    with pytest.raises(OSError, match="No space left"):
        spool.add("shot", PAIR, {})
    assert list((folder / "waiting").iterdir()) == []
    assert spool.first() is None


def test_everything_is_on_the_disk_before_a_pair_waits(
    spool: Spool, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    flush, rename = durable.flush, Path.rename

    def noted_flush(path: Path) -> None:
        done.append(f"flush {'partial' if path.name.startswith('.partial') else path.name}")
        flush(path)

    def noted_rename(path: Path, target: Path) -> Path:
        assert sorted(each.name for each in path.iterdir())[0] == "flash.dng"
        done.append("rename")
        return rename(path, target)

    monkeypatch.setattr(durable, "flush", noted_flush)
    monkeypatch.setattr(Path, "rename", noted_rename)
    spool.add("shot", PAIR, {})
    assert done == ["flush partial", "rename", "flush waiting"]


def test_a_pair_whose_name_may_not_be_on_the_disk_waits_all_the_same(
    spool: Spool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flush = durable.flush

    def failing_flush(path: Path) -> None:
        if path == folder / "waiting":
            raise OSError(5, "Input/output error")
        flush(path)

    with monkeypatch.context() as patch:
        patch.setattr(durable, "flush", failing_flush)
        added = spool.add("shot", PAIR, {})
    assert added.doubt == "input/output error"
    assert spool.first() == added
    assert spool.add("next", PAIR, {}).doubt is None
    assert shots(spool) == ["shot", "next"]


def test_uploads_are_remembered(spool: Spool, folder: Path) -> None:
    pair = spool.add("shot", PAIR, {})
    assert spool.uploads(pair) == {}
    spool.note_uploads(pair, {"no_flash": "1"})
    spool.note_uploads(pair, {"no_flash": "1", "flash": "2"})
    spool.close()
    again = Spool(folder)
    assert again.uploads(pair) == {"no_flash": "1", "flash": "2"}
    again.close()


@pytest.mark.parametrize("damaged", [b"{", b"[]", b"null", b"\xff"])
def test_uploads_that_cannot_be_read_are_begun_anew(spool: Spool, damaged: bytes) -> None:
    """Else the pair, and all behind it, were held up for ever."""
    pair = spool.add("shot", PAIR, {})
    (pair.folder / "uploads.json").write_bytes(damaged)
    assert spool.uploads(pair) == {}


def test_a_full_disk_keeps_no_pair_from_leaving(
    spool: Spool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = [spool.add(shot, PAIR, {}) for shot in ("sent", "refused")]

    def replace(_path: Path, _data: bytes) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(durable, "replace", replace)
        for number, pair in enumerate(pairs):
            spool.note_uploads(pair, {"no_flash": str(number)})
        assert [spool.uploads(pair) for pair in pairs] == [{"no_flash": "0"}, {"no_flash": "1"}]
        spool.remove(pairs[0])
        place = spool.put_aside(pairs[1], "The pair is black.")
    assert place == folder / "aside" / pairs[1].folder.name
    assert spool.first() is None
    again = spool.add("anew", PAIR, {})
    assert spool.uploads(again) == {}
    spool.note_uploads(again, {"flash": "2"})
    assert json.loads((again.folder / "uploads.json").read_bytes()) == {"flash": "2"}


@pytest.mark.parametrize("leaves", ["sent", "refused"])
def test_a_pair_in_the_place_of_one_that_left_has_no_uploads(
    spool: Spool, monkeypatch: pytest.MonkeyPatch, leaves: str
) -> None:
    def replace(_path: Path, _data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "replace", replace)
    pair = spool.add("shot", PAIR, {})
    spool.note_uploads(pair, {"flash": "1"})
    if leaves == "sent":
        spool.remove(pair)
    else:
        spool.put_aside(pair, "The pair is black.")
    again = spool.add("shot", PAIR, {})
    assert again.folder == pair.folder
    assert spool.uploads(again) == {}


@pytest.mark.parametrize("number", [5, 30])
def test_another_fault_of_the_disk_is_one(
    spool: Spool, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def replace(_path: Path, _data: bytes) -> None:
        raise OSError(number, "fault")

    pair = spool.add("shot", PAIR, {})
    monkeypatch.setattr(durable, "replace", replace)
    with pytest.raises(OSError, match="fault"):
        spool.note_uploads(pair, {"flash": "1"})
    with pytest.raises(OSError, match="fault"):
        spool.put_aside(pair, "reason")


def test_a_pair_put_aside_stays_with_its_reason(spool: Spool, folder: Path) -> None:
    for _ in range(2):  # the second one as if the first had been copied back
        pair = spool.add("shot", PAIR, {})
        place = spool.put_aside(pair, "The pair is black.")
        assert place.parent == folder / "aside"
        assert (place / "reason.txt").read_text() == "The pair is black.\n"
        assert (place / "flash.dng").read_bytes() == b"bright"
        assert spool.first() is None
    assert len(list((folder / "aside").iterdir())) == 2


@pytest.mark.parametrize("frame", ["no_flash", "flash"])
def test_damage_on_this_disk_is_seen(spool: Spool, frame: str) -> None:
    pair = spool.add("shot", PAIR, {})
    pair.path(frame).write_bytes(b"rot")
    assert pair.damage() == f"its photograph {frame} was damaged on this disk"


def break_json(pair: SpooledPair) -> None:
    (pair.folder / "pair.json").write_bytes(b"{")


def lose_json(pair: SpooledPair) -> None:
    (pair.folder / "pair.json").unlink()


def lose_photograph(pair: SpooledPair) -> None:
    pair.path("flash").unlink()


def lose_a_frame(pair: SpooledPair) -> None:
    about = json.loads((pair.folder / "pair.json").read_bytes())
    del about["photographs"]["flash"]
    (pair.folder / "pair.json").write_text(json.dumps(about))


@pytest.mark.parametrize("damage", [break_json, lose_json, lose_photograph, lose_a_frame])
def test_a_pair_that_cannot_be_read_is_told_and_holds_nothing_up(
    spool: Spool, folder: Path, damage: object
) -> None:
    assert callable(damage)
    damage(spool.add("bad", PAIR, {}))
    spool.add("good", PAIR, {})
    with pytest.raises(DamagedPairError, match=str(folder / "aside" / "000001-bad")):
        spool.first()
    assert shots(spool) == ["good"]
    assert [path.name for path in (folder / "aside").iterdir()] == ["000001-bad"]
