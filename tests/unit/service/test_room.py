from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.errors import QueueFullError, QuotaError, StorageFullError
from service.room import check_disk, check_room
from service.rows import keys
from service.settings import Settings
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from tests.unit.service.job_rows import added, claimed

MINE, OTHERS = "mine", "another's"


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"queued_jobs": 4, "queued_jobs_per_key": 3})


@pytest.fixture
def _waiting(engine: sa.Engine) -> None:
    """Two jobs wait, one of each owner; a third is begun."""
    for job_id, owner in (("a", MINE), ("b", OTHERS), ("c", MINE)):
        added(engine, job_id, owner=owner)
    claimed(engine, "c", "w")


@pytest.mark.usefixtures("_waiting")
@pytest.mark.parametrize(
    ("owner", "coming", "told"),
    [
        (MINE, 1, None),
        (MINE, 2, None),  # as many then wait as may, of this owner and in all
        (MINE, 3, "1 job of yours waits already, and 3 may; ask for fewer than these 3, or later."),
        ("new", 2, None),
        ("new", 3, "2 jobs wait already, and 4 may; ask for fewer than these 3, or later."),
        (
            "new",
            4,
            "0 jobs of yours wait already, and 3 may; ask for fewer than these 4, or later.",
        ),
    ],
)
def test_as_many_jobs_come_as_there_is_room_for(
    owner: str,
    coming: int,
    told: str | None,
    engine: sa.Engine,
    settings: Settings,
    storage: Storage,
) -> None:
    if told is None:
        check_room(engine, settings, storage, owner, coming)
        return
    with pytest.raises(QueueFullError) as refused:
        check_room(engine, settings, storage, owner, coming)
    assert str(refused.value) == told


def test_where_not_one_more_has_room_nobody_is_told_to_ask_for_fewer(
    engine: sa.Engine, settings: Settings, storage: Storage
) -> None:
    for job_id, owner in (("a", MINE), ("b", MINE), ("c", MINE), ("d", OTHERS)):
        added(engine, job_id, owner=owner)
    with pytest.raises(QueueFullError) as mine:
        check_room(engine, settings, storage, MINE)
    assert str(mine.value) == "3 jobs of yours wait already; send this one again later."
    with pytest.raises(QueueFullError) as several:
        check_room(engine, settings, storage, MINE, 2)
    assert str(several.value) == "3 jobs of yours wait already; ask for these 2 again later."
    with pytest.raises(QueueFullError) as others:
        check_room(engine, settings, storage, OTHERS)
    assert str(others.value) == "4 jobs wait already; send this one again later."


def test_a_quota_is_told_before_a_full_queue(
    engine: sa.Engine, settings: Settings, storage: Storage
) -> None:
    """It is the key's own, and waiting helps less."""
    quotas = keys.Quotas(jobs_per_day=2)
    with engine.begin() as connection:
        owner = keys.id_of(keys.create(connection, "a", {keys.Scope.SUBMIT}, quotas, None))
    check_room(engine, settings, storage, owner, 2)
    with pytest.raises(QuotaError):
        check_room(engine, settings, storage, owner, 9)


@pytest.mark.parametrize(
    ("free", "room"), [(None, True), (1001, True), (1000, True), (999, False), (0, False)]
)
def test_a_disk_that_is_nearly_full_takes_no_job(
    free: int | None,
    room: bool,
    engine: sa.Engine,
    settings: Settings,
    storage: Storage,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(FolderStorage, "free_bytes", lambda _storage: free)
    wanted = settings.model_copy(update={"free_bytes": 1000})
    if room:
        check_disk(wanted, storage)
        check_room(engine, wanted, storage, MINE)
        return
    with pytest.raises(StorageFullError, match="nearly full; delete jobs, or send this one again"):
        check_disk(wanted, storage)
    with pytest.raises(StorageFullError):
        check_room(engine, wanted, storage, MINE)
