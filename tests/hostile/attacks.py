"""Requests that nobody should send; each is drawn by chance, and may be several in a row."""

from __future__ import annotations

import base64
import hashlib
import json
import random
from collections.abc import Callable

from tests.hostile.photographs import Pair, damage
from tests.hostile.wire import Answer, Wire

Attack = Callable[[random.Random, Wire, dict[str, Pair]], list[Answer]]

_TUS = {"Tus-Resumable": "1.0.0"}
_PIECE = {**_TUS, "Content-Type": "application/offset+octet-stream"}
_NAMES = (
    "no_flash", "flash", "options", "handling", "third", "", "no_flash\0", "a" * 3000, "ü", "..",
)  # fmt: skip
_TYPES = (
    "", "image/heic", "application/octet-stream", "text/plain; charset=nothing", "multipart/mixed",
)  # fmt: skip
_TEXTS = (
    "{}", "", "[]", "null", "{", "[" * 5000, '{"lights": 2}', '{"lights": 1e999}', '{"a":' * 2000,
    '{"camera": {"calibration": "\\u0000"}}', '{"lights": NaN}', '{"exposure_ratio": -1}',
    '{"light_directions": [{"direction": [0, 0, 0]}]}', "\ud800", '{"flash_spectrum": {}}',
    '{"pinned_lamps": [{"x": 1e308, "y": -1e308, "radius": 1e308}]}',
    '{"lights": ' + "9" * 5000 + "}",
)  # fmt: skip
_DISPOSITIONS = (
    b"form-data", b'form-data; name="', b"form-data; name*=utf-8''%ff%00", b"", b"\xff\xfe",
)  # fmt: skip
_IDS = ("", "x", "../../jobs", "%00", "a" * 3000, "\0", "🎞", "' OR 1=1 --", "0" * 32)
_NUMBERS = ("-1", "0", "1", "99999999999999999999", "1e3", "", "\xd9\xa3", "0x10", "512")
_METHODS = ("POST", "PATCH", "PATCH", "PATCH", "HEAD", "DELETE", "OPTIONS", "GET")
_CHECKSUMS = ("sha1 AAAA", "md5 x", "sha256", "", "sha256 !!!", "sha1 " + "A" * 5000)
_PATHS = (
    "/jobs/%00", "/jobs/..%2f..%2fetc", "/jobs/" + "a" * 9000, "/jobs?limit=-1", "/uploads/",
    "/jobs?limit=99999999999999999999", "/jobs?after=%ff", "//", "/%", "/jobs/x/results/..%2f..",
    "/uploads/%00", "/readyz", "/jobs/x/cancel", "/calibrations", "*", "http://elsewhere/jobs",
)  # fmt: skip


def damaged_pair(chance: random.Random, wire: Wire, pairs: dict[str, Pair]) -> list[Answer]:
    """A pair with at least one damaged photograph."""
    frames = _damaged(chance, pairs)
    parts = [_part(name, data, chance.choice(_TYPES)) for name, data in frames.items()]
    if chance.random() < 0.3:
        parts.append(_part("options", _text(chance), None))
    return [_post_form(chance, wire, parts)]


def broken_form(chance: random.Random, wire: Wire, pairs: dict[str, Pair]) -> list[Answer]:
    """A multipart body that breaks the rules."""
    frames = _damaged(chance, pairs)
    good = [_part(name, data, "") for name, data in frames.items()]
    kind = chance.randrange(9)
    if kind == 0:
        parts = [_part(chance.choice(_NAMES), b"x", "") for _ in range(chance.choice((1, 3, 5000)))]
    elif kind == 1:
        parts = good * 2
    elif kind == 2:
        head = b'Content-Disposition: form-data; name="flash"\r\nX-Long: ' + b"a" * 100_000
        parts = [head + b"\r\n\r\n" + frames["flash"]]
    elif kind == 3:
        head = b"".join(b"X-%d: y\r\n" % number for number in range(1000))
        parts = [head + good[0], good[1]]
    elif kind == 4:
        inner = b"--inner\r\n" + good[0] + b"\r\n--inner--"
        parts = [_part("no_flash", inner, "multipart/mixed; boundary=inner"), good[1]]
    elif kind == 5:
        parts = [b"Content-Disposition: " + chance.choice(_DISPOSITIONS) + b"\r\n\r\nx", *good]
    elif kind == 6:
        parts = [*good, _part("options", b"x" * 3_000_000, None)]
    elif kind == 7:
        return [
            _post_form(chance, wire, good, boundary=chance.choice(("", "x" * 300, "\xff", '"')))
        ]
    else:
        return [_post_form(chance, wire, good, cut=True)]
    return [_post_form(chance, wire, parts)]


def hostile_json(chance: random.Random, wire: Wire, _pairs: dict[str, Pair]) -> list[Answer]:
    """JSON that names nothing, too much, or what is no JSON."""
    body = chance.choice(
        (
            _text(chance),
            json.dumps(
                {"uploads": {"no_flash": chance.choice(_IDS), "flash": chance.choice(_IDS)}}
            ),
            json.dumps({"uploads": {"no_flash": "0" * 32, "flash": 7}, "options": []}),
            json.dumps({"capture": {"camera": chance.choice(_IDS)}}),
            json.dumps({"capture": {"camera": "sim://studio?width=99999999"}, "priority": {}}),
            json.dumps({"uploads": {}, "webhook": {"url": "x", "secret": "y"}}),
        )
    )
    data = body if isinstance(body, bytes) else body.encode()
    if chance.random() < 0.3:
        data = damage(chance, data + b" ")
    headers = {"Content-Type": chance.choice(("application/json", "application/json; charset=x"))}
    if chance.random() < 0.3:
        headers["Idempotency-Key"] = chance.choice(("k", "", "x" * 5000, "\x7f", "a b"))
    return [wire.send("POST", chance.choice(("/jobs", "/calibrations")), headers, data)]


def bad_upload(chance: random.Random, wire: Wire, _pairs: dict[str, Pair]) -> list[Answer]:
    """Requests of tus with headers that cannot be."""
    created = wire.send("POST", "/uploads", {**_TUS, "Upload-Length": "1000"})
    place = created.headers.get("location", "/uploads/none")
    answers = [created]
    for _ in range(3):
        path = chance.choice((place, place, f"/uploads/{chance.choice(('x', '%00', 'a' * 500))}"))
        method = chance.choice(
            ("POST", "PATCH", "PATCH", "PATCH", "HEAD", "DELETE", "OPTIONS", "GET")
        )
        headers = dict(_PIECE)
        headers["Upload-Offset"] = chance.choice(_NUMBERS)
        headers["Upload-Length"] = chance.choice(_NUMBERS)
        if chance.random() < 0.4:
            headers["Upload-Checksum"] = chance.choice(_CHECKSUMS)
        if chance.random() < 0.3:
            headers["Upload-Metadata"] = chance.choice(("name", "x" * 5000, "\xff", "a b,c d"))
        if chance.random() < 0.2:
            headers["X-HTTP-Method-Override"] = chance.choice(
                ("PATCH", "DELETE", "nothing", "\xff")
            )
        if chance.random() < 0.2:
            headers["Tus-Resumable"] = chance.choice(("0.2.2", "", "2"))
        body = b"x" * chance.choice((0, 1, 500, 1000, 1001, 70_000))
        answers.append(wire.send(method, path, headers, body))
    return answers


def uploaded_pair(chance: random.Random, wire: Wire, pairs: dict[str, Pair]) -> list[Answer]:
    """A damaged pair in pieces, some of which break off, and the job that names it."""
    answers, ids = [], {}
    for frame, data in _damaged(chance, pairs).items():
        created = wire.send("POST", "/uploads", {**_TUS, "Upload-Length": str(len(data))})
        answers.append(created)
        if created.status != 201:
            return answers
        place = created.headers["location"]
        ids[frame] = place.rpartition("/")[2]
        answers += _send_pieces(chance, wire, place, data)
    body = json.dumps({"uploads": ids}).encode()
    return [*answers, wire.send("POST", "/jobs", {"Content-Type": "application/json"}, body)]


def no_http(chance: random.Random, wire: Wire, _pairs: dict[str, Pair]) -> list[Answer]:
    """What is hardly HTTP, or asks for what is not there."""
    kind = chance.randrange(5)
    if kind == 0:
        return [wire.send_bytes(chance.randbytes(chance.randrange(1, 2000)), True)]
    if kind == 1:
        head = "POST /jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
        extra = chance.choice(
            (
                "Content-Length: -5\r\n\r\n",
                "Content-Length: 5\r\nContent-Length: 6\r\n\r\n12345",
                "Transfer-Encoding: chunked\r\n\r\nzz\r\n",
                "Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nx",
                "X: " + "a" * 100_000 + "\r\n\r\n",
                "X\0Y: 1\r\n\r\n",
                "Content-Type: multipart/form-data; boundary=x\r\nContent-Length: 99\r\n\r\n--x",
            )
        )
        return [wire.send_bytes((head + extra).encode(), True)]
    if kind == 2:
        return [wire.send_bytes(b"POST /jobs HTTP/1.1\r\nHost: localhost\r\n", True)]
    method = chance.choice(("GET", "PUT", "DELETE", "PATCH", "POST", "OPTIONS", "NONSENSE"))
    headers = {"Host": "evil.example"} if chance.random() < 0.1 else {}
    return [wire.send(method, chance.choice(_PATHS), headers)]


ATTACKS: dict[Attack, int] = {
    damaged_pair: 55,
    broken_form: 15,
    hostile_json: 10,
    bad_upload: 7,
    uploaded_pair: 3,
    no_http: 10,
}
"""How often each of them is drawn, of a hundred."""


def _damaged(chance: random.Random, pairs: dict[str, Pair]) -> dict[str, bytes]:
    before, after = pairs[chance.choice(sorted(pairs))]
    if chance.random() < 0.1:
        after = pairs[chance.choice(sorted(pairs))][1]
    which = chance.randrange(3)
    return {
        "no_flash": before if which == 0 else damage(chance, before),
        "flash": after if which == 1 else damage(chance, after),
    }


def _text(chance: random.Random) -> bytes:
    return chance.choice(_TEXTS).encode("utf-8", "surrogatepass")


def _part(name: str, data: bytes, media_type: str | None) -> bytes:
    head = f'Content-Disposition: form-data; name="{name}"'
    if media_type is not None:
        head += '; filename="a.jpg"'
    if media_type:
        head += f"\r\nContent-Type: {media_type}"
    return head.encode() + b"\r\n\r\n" + data


def _post_form(
    chance: random.Random, wire: Wire, parts: list[bytes], boundary: str = "edge", cut: bool = False
) -> Answer:
    edge = boundary.encode("latin-1")
    body = (
        b"".join(b"--" + edge + b"\r\n" + part + b"\r\n" for part in parts) + b"--" + edge + b"--"
    )
    if cut:
        body = body[: chance.randrange(len(body))]
    headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
    return wire.send("POST", "/jobs", headers, body)


def _send_pieces(chance: random.Random, wire: Wire, place: str, data: bytes) -> list[Answer]:
    answers: list[Answer] = []
    offset = 0
    while offset < len(data):
        piece = data[offset : offset + chance.randrange(1, len(data) + 1)]
        headers = {**_PIECE, "Upload-Offset": str(offset)}
        if chance.random() < 0.3:  # the connection breaks in the middle
            promised = {**headers, "Content-Length": str(len(data) - offset)}
            wire.send("PATCH", place, promised, piece[: len(piece) // 2])
        elif chance.random() < 0.3:
            digest = base64.b64encode(hashlib.sha256(piece).digest()).decode()
            headers["Upload-Checksum"] = f"sha256 {digest}"
            answers.append(wire.send("PATCH", place, headers, piece))
        else:
            answers.append(wire.send("PATCH", place, headers, piece))
        told = wire.send("HEAD", place, _TUS)
        answers.append(told)
        if told.status != 200:
            return answers
        offset = int(told.headers["upload-offset"])
    return answers
