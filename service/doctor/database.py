"""Whether the database can be used, and what is in it for the service to work."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import sqlalchemy as sa

from service import migrations
from service.doctor.finding import Finding
from service.opening import NO_ROOM, WRONG_ADDRESS
from service.problems import cause_of
from service.rows import census, clock, database, keys
from service.settings import Settings

_CLOCKS_APART_SECONDS = 5  # this machine's and the database's


def look(settings: Settings) -> Iterator[Finding]:
    """Look at the database, its clock, its workers and its keys."""
    if is_missing_file(settings.database_url):
        yield Finding("note", "database", "there is none yet; `lightlayers serve` makes it.")
        yield _keys(settings, False)
        return
    try:
        engine = database.connect(settings.database_url)
    except (sa.exc.ArgumentError, ValueError):
        yield Finding("wrong", "database", WRONG_ADDRESS)
        return
    except (sa.exc.SQLAlchemyError, OSError, ImportError) as error:
        yield _no_database(error)
        return
    try:
        yield Finding("ok", "database", f"it answers, at schema {migrations.check(engine)}.")
        yield _clock(engine)
        yield _workers(engine, settings)
        with engine.connect() as connection:
            yield _keys(settings, keys.any_usable(connection))
    except migrations.SchemaError as error:
        yield Finding("wrong", "database", str(error))
    except (sa.exc.SQLAlchemyError, OSError) as error:
        yield _no_database(error)
    finally:
        engine.dispose()


def is_missing_file(url: str) -> bool:
    """Whether a URL is that of a file that the first start makes."""
    try:
        parsed = sa.make_url(url)
    except (sa.exc.ArgumentError, ValueError):
        return False
    if parsed.get_backend_name() != "sqlite":
        return False
    try:
        return parsed.database not in database.IN_MEMORY and not Path(str(parsed.database)).exists()
    except OSError:  # its folder may not be entered: opening it tells why
        return False


def _no_database(error: Exception) -> Finding:
    if database.is_full(error):
        return Finding("wrong", "database", NO_ROOM)
    return Finding(
        "wrong",
        "database",
        f"it does not answer ({cause_of(error)}): start it, or correct LIGHTLAYERS_DATABASE_URL.",
    )


def _clock(engine: sa.Engine) -> Finding:
    with engine.connect() as connection:
        apart = abs(connection.execute(sa.select(clock.now())).scalar_one() - time.time())
    if apart > _CLOCKS_APART_SECONDS:
        return Finding(
            "wrong",
            "clock",
            f"it differs by {apart:.0f} s from the database's: keep both by NTP, for S3 refuses "
            "requests of a wrong time.",
        )
    return Finding("ok", "clock", "it agrees with the database's.")


def _workers(engine: sa.Engine, settings: Settings) -> Finding:
    with engine.connect() as connection:
        living = census.living_workers(connection, settings.silence_seconds)
        waiting = census.longest_wait(connection)
    if not living:
        return Finding(
            "wrong",
            "workers",
            "none lives: start `lightlayers serve`, or `lightlayers worker` beside an API.",
        )
    said = f"{living} live; the oldest job has waited {waiting:.0f} s for one."
    return Finding("ok", "workers", said)


def _keys(settings: Settings, usable: bool) -> Finding:
    if keys.required(settings) and not usable:
        return Finding(
            "wrong",
            "keys",
            "requests need one, and none is good, so that `lightlayers serve` does not start: make "
            "one with `lightlayers keys create NAME`, or let LIGHTLAYERS_HOST be 127.0.0.1.",
        )
    return Finding("ok", "keys", "there is one." if usable else "none is needed to start.")
