"""Reads a multipart form as it comes: its files go straight to a folder, its texts into memory."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from service.errors import MalformedRequestError

_TEXT_BYTES = 1024 * 1024  # of a part; options with tables of spectra take some kilobytes


@dataclass(frozen=True)
class Form:
    """What has come. A part is a file or a text by its name, however it was sent."""

    sha256: dict[str, str] = field(default_factory=dict)
    """Digests of the files, by the names of their parts; the files in the folder bear these."""
    texts: dict[str, str] = field(default_factory=dict)


async def read_form(
    request: Request, folder: Path, files: Collection[str], texts: Collection[str]
) -> Form:
    """Read the form that a request holds.

    files, texts: names of the parts that may be there, each once. Raises MalformedRequestError, as
    soon as what has come cannot be such a form.
    """
    parser = _Parser(_boundary(request), folder, files, texts)
    try:
        async for chunk in request.stream():
            await run_in_threadpool(parser.write, chunk)
    finally:
        parser.close()
    return parser.form()


def _boundary(request: Request) -> bytes:
    boundary = parse_options_header(request.headers.get("content-type"))[1].get(b"boundary")
    if not boundary:
        raise MalformedRequestError("The multipart body cannot be read: its boundary is missing.")
    return boundary


class _Parser:
    def __init__(
        self, boundary: bytes, folder: Path, files: Collection[str], texts: Collection[str]
    ) -> None:
        self._folder = folder
        self._files = files
        self._texts = texts
        self._form = Form()
        self._ended = False
        self._name = ""
        self._header = bytearray()
        self._value = bytearray()
        self._disposition = b""
        self._file: IO[bytes] | None = None
        self._digest = hashlib.sha256()
        self._text = bytearray()
        try:
            self._parser = MultipartParser(
                boundary,
                {
                    "on_part_begin": self._begin_part,
                    "on_header_field": self._take_header,
                    "on_header_value": self._take_value,
                    "on_header_end": self._end_header,
                    "on_headers_finished": self._open_part,
                    "on_part_data": self._take_data,
                    "on_part_end": self._end_part,
                    "on_end": self._end,
                },
            )
        except FormParserError as error:
            raise MalformedRequestError(
                "The multipart body cannot be read: its boundary is too long."
            ) from error

    def write(self, chunk: bytes) -> None:
        """Take what came next."""
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise MalformedRequestError(
                "The multipart body cannot be read: it breaks the rules of multipart/form-data."
            ) from error

    def form(self) -> Form:
        """Give what has come once all has."""
        if not self._ended:
            raise MalformedRequestError(
                "The multipart body cannot be read: it ends before its last boundary."
            )
        return self._form

    def close(self) -> None:
        """Let go of the file of a part that did not end."""
        if self._file:
            self._file.close()

    def _begin_part(self) -> None:
        self._disposition = b""

    def _take_header(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _take_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _end_header(self) -> None:
        if self._header.lower() == b"content-disposition":
            self._disposition = bytes(self._value)
        self._header.clear()
        self._value.clear()

    def _open_part(self) -> None:
        name = parse_options_header(self._disposition)[1].get(b"name")
        if name is None:
            raise MalformedRequestError(
                "A part of the multipart body has no name: name it in its Content-Disposition."
            )
        self._name = name.decode("utf-8", "replace")
        if self._name not in (*self._files, *self._texts):
            *most, last = *self._files, *self._texts
            raise MalformedRequestError(
                f"The part {self._name[:32]!r} is unknown; the parts are {', '.join(most)} "
                f"and {last}."
            )
        if self._name in self._form.sha256 or self._name in self._form.texts:
            raise MalformedRequestError(f"The part {self._name} comes twice; send it once.")
        if self._name in self._files:
            self._file = (self._folder / self._name).open("wb")
            self._digest = hashlib.sha256()
        self._text.clear()

    def _take_data(self, data: bytes, start: int, end: int) -> None:
        if self._file:
            part = memoryview(data)[start:end]
            self._digest.update(part)
            self._file.write(part)
            return
        self._text += data[start:end]
        if len(self._text) > _TEXT_BYTES:
            raise MalformedRequestError(
                f"The part {self._name} is larger than {_TEXT_BYTES:,} bytes: name calibrations in "
                "place of tables, and send photographs in the parts of their own."
            )

    def _end_part(self) -> None:
        if self._file:
            self._file.close()
            self._file = None
            self._form.sha256[self._name] = self._digest.hexdigest()
            return
        try:
            self._form.texts[self._name] = self._text.decode()
        except UnicodeDecodeError as error:
            raise MalformedRequestError(
                f"The part {self._name} is no UTF-8 text: write its JSON so."
            ) from error

    def _end(self) -> None:
        self._ended = True
