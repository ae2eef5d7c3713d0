"""The tables of the service, column by column; those of the queue are DBOS's own."""

from __future__ import annotations

import sqlalchemy as sa

metadata = sa.MetaData()
"""Where the steps of service.migrations lead."""

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    # Counts the writes of the row, so that who watches it knows whether it has changed.
    sa.Column("revision", sa.Integer, nullable=False, default=1),
    sa.Column("owner", sa.String(32), nullable=False, default=""),  # id of a key; "" without keys
    sa.Column("state", sa.String(24), nullable=False),
    # Jobs wait in the order of their ranks; see service.rows.fairness.
    sa.Column("priority", sa.String(8), nullable=False, default="normal"),
    sa.Column("rank", sa.Integer, nullable=False, default=1),
    sa.Column("stage", sa.String(16)),
    sa.Column("fraction", sa.Double, nullable=False, default=0.0),
    # How much of the whole attempt is done, and when it is likely to end: service.rows.eta.
    sa.Column("progress", sa.Double, nullable=False, default=0.0),
    sa.Column("eta", sa.Double),
    sa.Column("likeness", sa.String(64), nullable=False, default=""),
    sa.Column("stage_seconds", sa.JSON(none_as_null=True)),
    # Attempts are numbered from 1; `attempt` is the last one started and the only one that may
    # write. `lost` counts those whose worker died under them.
    sa.Column("attempt", sa.Integer, nullable=False, default=0),
    sa.Column("lost", sa.Integer, nullable=False, default=0),
    sa.Column("worker", sa.String(64)),
    sa.Column("options", sa.JSON, nullable=False),
    sa.Column("capture", sa.JSON(none_as_null=True)),
    sa.Column("camera", sa.String(16)),  # id of the one that takes the pair: service.rows.cameras
    # What it was set to for the pair, by name.
    sa.Column("camera_settings", sa.JSON(none_as_null=True)),
    sa.Column("inputs", sa.JSON(none_as_null=True)),
    sa.Column("results", sa.JSON(none_as_null=True)),
    sa.Column("error", sa.JSON(none_as_null=True)),
    sa.Column("trace_id", sa.String(32), nullable=False),
    sa.Column("span_id", sa.String(16)),  # of the request in the trace, where traces are made
    # What a person is asked to do, the number of the request, and until when it waits.
    sa.Column("request", sa.String(200)),
    sa.Column("requests", sa.Integer, nullable=False, default=0),
    sa.Column("request_until", sa.Double),
    sa.Column("webhook", sa.JSON(none_as_null=True)),
    # How far the delivery to the webhook is; null until its first attempt is queued.
    sa.Column("delivery", sa.JSON(none_as_null=True)),
    sa.Column("idempotency_key", sa.String(255)),
    sa.Column("request_hash", sa.String(64), nullable=False),
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("started", sa.Double),
    sa.Column("finished", sa.Double),
    sa.Column("deadline", sa.Double),  # fails when it has not ended by then
    sa.Column("expires", sa.Double),  # is removed then
    sa.Column("stored_bytes", sa.BigInteger, nullable=False, default=0),  # photographs and results
    sa.UniqueConstraint("owner", "idempotency_key", name="jobs_by_idempotency_key"),
    sa.Index("jobs_by_age", "owner", "created", "id"),
    sa.Index("jobs_by_time", "created", "id"),  # those of all owners
    sa.Index("jobs_by_bytes", "owner", "stored_bytes"),  # added up without a look at the rows
    # Whatever looks at waiting or ended jobs reads as much of an index as it finds, and no more.
    sa.Index("jobs_by_state", "state", "created", "id"),
    sa.Index("jobs_by_rank", "state", "rank", "created", "id"),
    sa.Index("jobs_by_flow", "state", "owner", "priority", "rank"),
    sa.Index("jobs_by_deadline", "state", "deadline"),
    sa.Index("jobs_by_expiry", "state", "expires"),
    sa.Index("jobs_by_likeness", "likeness", "state", "created"),
    sa.Index("jobs_by_camera", "camera", "state"),
)

# Few rows at any time, so that workers may look often: a job leaves it when its delivery begins.
sa.Index(
    "jobs_with_news",
    jobs.c.finished,
    sqlite_where=jobs.c.webhook.is_not(None) & jobs.c.delivery.is_(None),
    postgresql_where=jobs.c.webhook.is_not(None) & jobs.c.delivery.is_(None),
)

CALIBRATES = jobs.c.likeness.like(sa.literal_column("'calibrate-%'"))
"""Whether a job is a calibration. Spelt out, with no parameter, it is found by its index."""

# Few rows beside an owner's separations, each of which may look for calibrations.
# By the state, too: SQLite, which counts nothing, would take jobs_by_age for as good.
sa.Index(
    "jobs_that_calibrate",
    jobs.c.owner,
    jobs.c.state,
    jobs.c.created,
    sqlite_where=CALIBRATES,
    postgresql_where=CALIBRATES,
)

# Cameras that somebody has asked for, as they were when they last answered.
cameras = sa.Table(
    "cameras",
    metadata,
    sa.Column("id", sa.String(16), primary_key=True),
    sa.Column("address", sa.String(300), nullable=False),
    sa.Column("make", sa.String(255), nullable=False, default=""),
    sa.Column("model", sa.String(255), nullable=False, default=""),
    sa.Column("serial", sa.String(255), nullable=False, default=""),
    sa.Column("battery_percent", sa.Integer),
    sa.Column("free_bytes", sa.BigInteger),
    sa.Column("answered", sa.Boolean, nullable=False, default=False),  # when last looked at
    sa.Column("looked", sa.Double, nullable=False, default=0.0),
    # Until then at most somebody looks at it or sets it, and no job may begin to use it.
    sa.Column("taken_until", sa.Double, nullable=False, default=0.0),
    # On whose USB it was last seen, where a worker can use it: service.workers.host.
    sa.Column("host", sa.String(32)),
)

workers = sa.Table(
    "workers",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("seen", sa.Double, nullable=False),
)

keys = sa.Table(
    "keys",
    metadata,
    sa.Column("id", sa.String(16), primary_key=True),  # a part of the key; owner of its jobs
    sa.Column("digest", sa.String(64), nullable=False),  # SHA-256 of the key, hexadecimal
    sa.Column("name", sa.String(100), nullable=False),
    sa.Column("scopes", sa.JSON, nullable=False),
    # Quotas; null where there is none.
    sa.Column("waiting_jobs", sa.Integer),
    sa.Column("jobs_per_day", sa.Integer),
    sa.Column("stored_bytes", sa.BigInteger),
    # Jobs made on `day`, which counts from 1970, in UTC.
    sa.Column("day", sa.Integer, nullable=False, default=0),
    sa.Column("jobs_of_day", sa.Integer, nullable=False, default=0),
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("expires", sa.Double),
    sa.Column("revoked", sa.Double),
    sa.Column("used", sa.Double),  # to the hour, so that requests do not write
)

# One row: which database this is, and since when it has a name; its store has the id, too.
identity = sa.Table(
    "identity",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("created", sa.Double, nullable=False),
)

# Photographs that come piece by piece (tus), until a job takes them over.
uploads = sa.Table(
    "uploads",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("owner", sa.String(32), nullable=False, default=""),
    sa.Column("length", sa.BigInteger, nullable=False),
    sa.Column("received", sa.BigInteger, nullable=False, default=0),
    sa.Column("parts", sa.JSON, nullable=False),  # names of the objects that hold it, in order
    sa.Column("metadata", sa.Text),  # as the client sent it
    sa.Column("expires", sa.Double, nullable=False),
    sa.Index("uploads_by_expiry", "expires"),
)
