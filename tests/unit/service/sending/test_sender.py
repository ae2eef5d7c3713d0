from __future__ import annotations

import io
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import httpx
import numpy as np
import pytest
from PIL import Image

from service.sending import sender as module
from service.sending.client import Client, Job
from service.sending.failures import RefusedError, ServiceAwayError
from service.sending.sender import Sender
from service.sending.spool import Spool
from tests.chaos.relay import Relay
from tests.unit.service.at_first import raising
from tests.unit.service.fake_service import FakeService

Png = Callable[..., bytes]


class Told:
    """What a sender told, and the moment of it."""

    def __init__(self) -> None:
        self.events: list[tuple[str, str, dict[str, Any]]] = []
        self._came = threading.Condition()

    def __call__(self, event: str, sentence: str, **facts: Any) -> None:
        with self._came:
            self.events.append((event, sentence, facts))
            self._came.notify_all()

    def await_event(self, event: str, count: int = 1) -> str:
        """Wait until it was told so often; the sentence."""

        def told() -> list[str]:
            return [sentence for name, sentence, _ in self.events if name == event]

        with self._came:
            assert self._came.wait_for(lambda: len(told()) >= count, timeout=60), self.events
        return told()[count - 1]

    @property
    def names(self) -> list[str]:
        return [event for event, _, _ in self.events]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PAUSES_S", (0.01,))


@pytest.fixture
def spool(tmp_path: Path) -> Iterator[Spool]:
    spool = Spool(tmp_path / "spool")
    yield spool
    spool.close()


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def pairs(png: Png) -> list[dict[str, tuple[str, bytes]]]:
    """Three pairs that differ."""
    return [
        {"no_flash": ("png", png(64, 48 + n)), "flash": ("png", png(64, 48 + n, True))}
        for n in range(3)
    ]


@pytest.fixture
def service() -> Iterator[FakeService]:
    with FakeService() as service:
        yield service


def jobs_of(http: httpx.Client) -> list[Job]:
    """Every job of the service, the oldest first."""
    found: list[Job] = http.get("/jobs").raise_for_status().json()["jobs"]
    return found[::-1]


def stored(http: httpx.Client) -> list[dict[str, str]]:
    return [
        {frame: file["sha256"] for frame, file in job["inputs"].items()} for job in jobs_of(http)
    ]


def test_pairs_arrive_in_order_each_once(
    http: httpx.Client, spool: Spool, told: Told, pairs: list[dict[str, tuple[str, bytes]]]
) -> None:
    sent = [spool.add(f"shot{n}", pair, {"lights": 2}).sha256 for n, pair in enumerate(pairs[:2])]
    with Client(str(http.base_url)) as client:
        sender = Sender(spool, client, told)
        told.await_event("sent", 2)
        sent.append(spool.add("shot2", pairs[2], {}).sha256)
        sender.notice()
        sender.finish()
    assert stored(http) == sent
    assert [job["options"] for job in jobs_of(http)] == [{"lights": 2}, {"lights": 2}, {}]
    assert (spool.count(), sender.aside) == (0, 0)
    assert [(event, facts["shot"]) for event, _, facts in told.events] == [
        ("sent", f"shot{n}") for n in range(3)
    ]
    assert [facts["job"] for _, _, facts in told.events] == [job["id"] for job in jobs_of(http)]


def large(seed: int) -> bytes:
    """A PNG of two megabytes."""
    file = io.BytesIO()
    noise = np.random.default_rng(seed).integers(0, 200, (800, 900, 3), np.uint8)
    Image.fromarray(noise).save(file, "PNG", compress_level=0)
    return file.getvalue()


def test_a_cut_network_holds_pairs_up_and_an_upload_goes_on_where_it_broke(
    http: httpx.Client, spool: Spool, told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    relay = Relay(http.base_url.port or 80)
    relay.cut_after(1_500_000)
    pair = {"no_flash": ("png", large(1)), "flash": ("png", large(2))}
    sent = spool.add("shot", pair, {})
    offsets: list[int] = []
    append = Client.append_to_upload

    def noted(client: Client, upload: str, file: BinaryIO, offset: int, size: int) -> None:
        offsets.append(offset)
        append(client, upload, file, offset, size)

    monkeypatch.setattr(Client, "append_to_upload", noted)
    url = str(http.base_url)
    with Client(url) as near, Client(f"http://127.0.0.1:{relay.port}") as client:
        sender = Sender(spool, client, told)
        assert "does not answer" in told.await_event("held")
        (upload,) = spool.uploads(sent).values()
        while not near.upload_offset(upload):
            pass  # until the service has kept what came
        relay.mend()
        sender.finish()
    assert stored(http) == [sent.sha256]
    assert offsets[0] == 0
    assert 1_000_000 < offsets[1] < len(pair["no_flash"][1])
    assert told.names == ["held", "sent"]


class LostAnswers(Client):
    """A service whose answers get lost: every request is done, and the first of each kind fails."""

    def __init__(self, url: str) -> None:
        super().__init__(url)
        self.lost: set[str] = set()

    def _lose(self, kind: str) -> None:
        if kind not in self.lost:
            self.lost.add(kind)
            raise ServiceAwayError("The answer got lost.")

    def create_upload(self, size: int) -> str:
        upload = super().create_upload(size)
        self._lose("create")
        return upload

    def append_to_upload(self, upload_id: str, file: BinaryIO, offset: int, size: int) -> None:
        super().append_to_upload(upload_id, file, offset, size)
        self._lose("append")

    def submit_uploads(
        self, uploads: Mapping[str, str], options: Mapping[str, Any], idempotency_key: str
    ) -> Job:
        job = super().submit_uploads(uploads, options, idempotency_key)
        self._lose("submit")
        return job


def test_answers_that_get_lost_make_no_second_job(
    http: httpx.Client, spool: Spool, told: Told, pairs: list[dict[str, tuple[str, bytes]]]
) -> None:
    sent = [spool.add(f"shot{n}", pair, {}).sha256 for n, pair in enumerate(pairs)]
    with LostAnswers(str(http.base_url)) as client:
        Sender(spool, client, told).finish()
        assert client.lost == {"create", "append", "submit"}
    assert stored(http) == sent
    assert spool.count() == 0


@pytest.mark.parametrize("die_after", ["create", "append", "submit"])
def test_an_agent_that_died_is_gone_on_with(
    http: httpx.Client,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    die_after: str,
) -> None:
    pair = spool.add("shot", pairs[0], {})
    with Client(str(http.base_url)) as client:  # as far as the one before had come
        uploads: dict[str, str] = {}
        for frame in ("no_flash", "flash"):
            path = pair.path(frame)
            uploads[frame] = client.create_upload(path.stat().st_size)
            if die_after != "create":
                with path.open("rb") as file:
                    client.append_to_upload(uploads[frame], file, 0, path.stat().st_size)
        spool.note_uploads(pair, uploads)
        if die_after == "submit":
            client.submit_uploads(uploads, {}, pair.about.id)
        Sender(spool, client, told).finish()
    assert stored(http) == [pair.sha256]
    assert told.names == ["sent"]


@pytest.mark.parametrize("both", [True, False])
def test_uploads_that_have_expired_are_sent_anew(
    both: bool,
    http: httpx.Client,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
) -> None:
    pair = spool.add("shot", pairs[0], {})
    with Client(str(http.base_url)) as client:
        flash = "1" * 32 if both else client.create_upload(pair.path("flash").stat().st_size)
        spool.note_uploads(pair, {"no_flash": "0" * 32, "flash": flash})
        Sender(spool, client, told).finish()
    assert stored(http) == [pair.sha256]
    assert told.names == ["held", "sent"]


def test_a_pair_that_will_never_pass_is_put_aside_and_told(
    http: httpx.Client,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    tmp_path: Path,
) -> None:
    spool.add("black", {"no_flash": ("png", b"no picture"), "flash": pairs[0]["flash"]}, {})
    spool.add("odd", pairs[0], {"lights": 7})
    good = spool.add("good", pairs[1], {})
    with Client(str(http.base_url)) as client:
        sender = Sender(spool, client, told)
        sender.finish()
    assert stored(http) == [good.sha256]
    assert (told.names, sender.aside) == (["aside", "aside", "sent"], 2)
    _, sentence, facts = told.events[0]
    assert "without the flash" in sentence
    assert sentence.endswith(f"The pair is put aside in {facts['folder']}.")
    assert (facts["shot"], facts["status"]) == ("black", 422)
    place = tmp_path / "spool" / "aside" / "000001-black"
    assert (place / "reason.txt").read_text() == f"{facts['reason']}\n"
    assert (place / "no_flash.png").read_bytes() == b"no picture"
    assert "lights" in told.events[1][1]


def test_a_pair_whose_options_name_no_spectrum_goes_once_they_are_mended(
    http: httpx.Client,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    tmp_path: Path,
) -> None:
    pair = spool.add("shot", pairs[0], {"flash_spectrum": "xenonn"})
    with Client(str(http.base_url)) as client:
        Sender(spool, client, told).finish()
        aside = tmp_path / "spool" / "aside" / pair.folder.name
        said = "flash_spectrum: No flash spectrum is called 'xenonn': near names are xenon.\n"
        assert (aside / "reason.txt").read_text() == said
        assert jobs_of(http) == []
        about = aside / "pair.json"
        about.write_text(about.read_text().replace("xenonn", "xenon"))
        aside.rename(pair.folder)
        Sender(spool, client, told).finish()
    assert stored(http) == [pair.sha256]
    assert told.names == ["aside", "sent"]


def test_a_pair_waits_for_the_calibration_that_its_options_name(
    http: httpx.Client,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    finish: Callable[[str, dict[str, bytes]], None],
) -> None:
    card = {"kind": "flash", "card": {"x": 20, "y": 20, "radius": 5}}
    wanted = {"capture": {"camera": "sim://studio"}, "options": card}
    calibration = http.post("/calibrations", json=wanted).json()["id"]
    sent = spool.add("shot", pairs[0], {"flash_spectrum": {"calibration": calibration}})
    with Client(str(http.base_url)) as client:
        sender = Sender(spool, client, told)
        assert "wait until it has succeeded" in told.await_event("held")
        finish(calibration, {"flash.json": b"wavelength_nm,power\n400,0.5\n700,1\n"})
        sender.finish()
    # A look between the two may tell again that it is held.
    assert (set(told.names), told.names[-1], sender.aside) == ({"held", "sent"}, "sent", 0)
    assert [job["inputs"]["flash"]["sha256"] for job in jobs_of(http)[1:]] == [sent.sha256["flash"]]


def test_a_pair_that_this_disk_damaged_is_not_sent(
    service: FakeService, spool: Spool, told: Told, pairs: list[dict[str, tuple[str, bytes]]]
) -> None:
    pair = spool.add("shot", pairs[0], {})
    pair.path("flash").write_bytes(pairs[1]["flash"][1])
    (spool.add("other", pairs[1], {}).folder / "pair.json").unlink()
    sender = Sender(spool, service, told)
    sender.finish()
    assert service.jobs == {}
    assert "Its photograph flash was damaged on this disk." in told.events[0][1]
    assert "could not be read" in told.events[1][1]
    assert sender.aside == 2


def test_other_bytes_than_were_sent_are_no_receipt(
    service: FakeService,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    append = FakeService.append_to_upload

    def damaging(service: FakeService, upload: str, *arguments: Any) -> None:
        append(service, upload, *arguments)
        service.uploads[upload] = service.uploads[upload][::-1]

    monkeypatch.setattr(FakeService, "append_to_upload", damaging)
    spool.add("shot", pairs[0], {})
    Sender(spool, service, told).finish()
    assert "The service has other bytes than were sent, see its job job0." in told.events[0][1]
    assert (tmp_path / "spool" / "aside" / "000001-shot" / "flash.png").is_file()
    assert told.names == ["aside"]


def refusal(status: int | None, final: bool = False) -> RefusedError:
    return RefusedError(f"No, {status}.", status, final)


@pytest.mark.parametrize(
    "error",
    [refusal(401), refusal(403), refusal(404), refusal(409), refusal(429), ServiceAwayError("No.")],
    ids=str,
)
def test_what_may_pass_later_is_held_and_told_once(
    service: FakeService,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    error: Exception,
) -> None:
    service.error = error
    sent = [spool.add(f"shot{n}", pair, {}).sha256 for n, pair in enumerate(pairs[:2])]
    sender = Sender(spool, service, told)
    for _ in range(4):
        assert service.tries.acquire(timeout=60)
    assert told.events == [
        (
            "held",
            f"{error} 2 pairs wait in the spool {spool.folder}.",
            {"reason": str(error), "spool": str(spool.folder), "waiting": 2},
        )
    ]
    service.error = None
    sender.finish()
    assert service.stored == sent
    assert sender.aside == 0


def test_a_service_that_is_away_once_more_is_told_once_more(
    service: FakeService, spool: Spool, told: Told, pairs: list[dict[str, tuple[str, bytes]]]
) -> None:
    sender = Sender(spool, service, told)
    for number, pair in enumerate(pairs[:2], 1):
        service.error = ServiceAwayError("No.")
        spool.add(f"shot{number}", pair, {})
        sender.notice()
        told.await_event("held", number)
        service.error = None
        told.await_event("sent", number)
    assert sender.finish()
    assert told.names == ["held", "sent", "held", "sent"]


def test_a_disk_that_fails_and_a_fault_of_the_program_are_told_and_outlived(
    service: FakeService,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    errors: list[Exception] = [OSError(5, "Input/output error"), ZeroDivisionError("secret")]
    first = Spool.first

    def failing(spool: Spool) -> Any:
        if errors:
            raise errors.pop(0)
        return first(spool)

    monkeypatch.setattr(Spool, "first", failing)
    pair = spool.add("shot", pairs[0], {})
    Sender(spool, service, told).finish()
    assert service.stored == [pair.sha256]
    assert "cannot be read or written: input/output error." in told.events[0][1]
    assert "please report it: ZeroDivisionError." in told.events[1][1]
    assert "secret" not in told.events[1][1]


@pytest.mark.parametrize(
    "error",
    [BrokenPipeError(32, "Broken pipe"), OSError(28, "No space left"), ValueError("closed")],
)
def test_pairs_are_sent_also_where_nobody_can_be_told(
    service: FakeService,
    spool: Spool,
    pairs: list[dict[str, tuple[str, bytes]]],
    error: Exception,
) -> None:
    service.error = refusal(429)  # held up, then put aside, then sent
    (spool.add("damaged", pairs[0], {}).folder / "pair.json").unlink()
    sent = [spool.add(f"shot{n}", pair, {}).sha256 for n, pair in enumerate(pairs[:2])]
    sender = Sender(spool, service, raising(error))
    assert service.tries.acquire(timeout=60)
    service.error = None
    assert sender.finish()
    assert service.stored == sent
    assert (spool.count(), sender.aside) == (0, 1)


def test_a_spool_that_cannot_be_read_is_told_and_outlived(
    service: FakeService,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    tmp_path: Path,
) -> None:
    waiting, away = tmp_path / "spool" / "waiting", tmp_path / "away"
    pair = spool.add("shot", pairs[0], {})
    waiting.rename(away)
    sender = Sender(spool, service, told)
    reason = "The spool cannot be read or written: no such file or directory."
    said = f"{reason} See to {spool.folder} and its disk, then it goes on."
    assert told.await_event("held") == said
    away.rename(waiting)
    sender.finish()
    assert service.stored == [pair.sha256]
    assert told.events[0] == ("held", said, {"reason": reason, "spool": str(spool.folder)})


@pytest.mark.parametrize("broken", ["shutil.rmtree", "durable.flush", "Spool.count"])
def test_a_pair_that_has_gone_is_told_as_sent_whatever_its_folder_does(
    broken: str,
    service: FakeService,
    spool: Spool,
    told: Told,
    pairs: list[dict[str, tuple[str, bytes]]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fails = raising(OSError(5, "Input/output error"))
    spool.add("shot", pairs[0], {})
    with monkeypatch.context() as patched:
        patched.setattr(f"service.sending.spool.{broken}", fails)
        patched.setattr(Spool, "note_uploads", lambda *_: None)  # which flushes, too
        assert Sender(spool, service, told).finish()
    waiting = {} if broken == "Spool.count" else {"waiting": 0}
    assert told.events == [("sent", "shot: job job0", {"shot": "shot", "job": "job0", **waiting})]
    spool.close()
    Spool(spool.folder).close()
    assert list((spool.folder / "waiting").iterdir()) == []


def test_a_sender_that_is_stopped_begins_nothing_more(
    service: FakeService, spool: Spool, told: Told, pairs: list[dict[str, tuple[str, bytes]]]
) -> None:
    sender = Sender(spool, service, told)
    sender.stop()
    sender._thread.join()
    spool.add("shot", pairs[0], {})
    sender.notice()
    assert not sender.finish()
    assert (service.jobs, spool.count()) == ({}, 1)
