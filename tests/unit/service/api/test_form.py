"""Forms byte by byte, in pieces of every size."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi import Request
from starlette.types import Message

from service.api.form import Form, read_form
from service.errors import MalformedRequestError

PHOTOGRAPH = b"\r\n--edg\r\n-\0\xff" * 40


def _read(body: bytes, folder: Path, size: int = 10_000, boundary: str = "; boundary=edge") -> Form:
    pieces = [body[start : start + size] for start in range(0, len(body), size)]

    def messages() -> Iterator[Message]:
        for piece in pieces:
            yield {"type": "http.request", "body": piece, "more_body": True}
        yield {"type": "http.request", "body": b"", "more_body": False}

    left = messages()

    async def receive() -> Message:
        return next(left)

    headers = [(b"content-type", f"multipart/form-data{boundary}".encode())]
    request = Request({"type": "http", "headers": headers}, receive)
    return asyncio.run(read_form(request, folder, ("flash",), ("options", "handling")))


def _part(name: bytes, data: bytes, more: bytes = b"") -> bytes:
    head = b'--edge\r\nContent-Disposition: form-data; name="' + name + b'"'
    return head + more + b"\r\n\r\n" + data + b"\r\n"


FORM = _part(b"flash", PHOTOGRAPH, b'; filename="x"') + _part(b"options", "{ü}".encode())
END = b"--edge--\r\n"


@pytest.mark.parametrize("size", [1, 7, 64, 10_000])
def test_files_go_to_the_folder_and_texts_to_memory(tmp_path: Path, size: int) -> None:
    form = _read(b"\r\n" + FORM + END + b"epilogue", tmp_path, size)
    assert (tmp_path / "flash").read_bytes() == PHOTOGRAPH
    assert form.sha256 == {"flash": hashlib.sha256(PHOTOGRAPH).hexdigest()}
    assert form.texts == {"options": "{ü}"}
    assert [path.name for path in tmp_path.iterdir()] == ["flash"]


def test_an_empty_file_is_a_file(tmp_path: Path) -> None:
    assert _read(_part(b"flash", b"") + END, tmp_path).sha256["flash"].startswith("e3b0c442")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "ends before its last boundary"),
        (FORM, "ends before its last boundary"),
        (FORM + END[:-5], "ends before its last boundary"),
        (b"--other\r\n", "breaks the rules"),
        (b"--edge\r\nnonsense\r\n\r\nx\r\n" + END, "breaks the rules"),
        (b"--edge\r\nX: " + b"y" * 100_000 + b"\r\n\r\n" + END, "breaks the rules"),
        (b"--edge\r\n" + b"X: y\r\n" * 1000 + b"\r\nx\r\n" + END, "breaks the rules"),
        (b"--edge\r\n\r\nx\r\n" + END, "has no name"),
        (b"--edge\r\nContent-Disposition: form-data\r\n\r\nx\r\n" + END, "has no name"),
        (FORM + FORM + END, "The part flash comes twice"),
        (_part(b"options", b"{}") * 2 + END, "The part options comes twice"),
        (_part(b"third", b"x") + END, "'third' is unknown; the parts are flash, options and handl"),
        (_part(b"flash\0", b"x") + END, r"'flash\x00' is unknown"),
        (_part(b"../flash", b"x") + END, "'../flash' is unknown"),
        (_part(b"\xff\xfe", b"x") + END, "is unknown"),
        (_part(b"a" * 3000, b"x") + END, f"'{'a' * 32}' is unknown"),
        (_part(b"", b"x") + END, "'' is unknown"),
        (_part(b"options", b"x" * 1_100_000) + END, "options is larger than 1,048,576 bytes"),
        (
            _part(b"options", b"\xff\xfe{") + END,
            "The part options is no UTF-8 text: write its JSON so.",
        ),
    ],
)
def test_what_is_no_such_form_is_refused(body: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(MalformedRequestError) as error:
        _read(body, tmp_path)
    assert words in str(error.value)
    assert str(error.value).endswith(".")


@pytest.mark.parametrize("boundary", ["", "; boundary=", "; boundary", "; boundary=" + "x" * 300])
def test_a_boundary_that_cannot_be_is_refused(boundary: str, tmp_path: Path) -> None:
    with pytest.raises(MalformedRequestError, match="its boundary is"):
        _read(FORM + END, tmp_path, boundary=boundary)
    assert list(tmp_path.iterdir()) == []
