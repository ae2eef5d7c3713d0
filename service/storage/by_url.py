"""The store at a URL."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from service.storage.base import Storage
from service.storage.bucket import BucketStorage
from service.storage.folder import FolderStorage


def storage_at(url: str) -> Storage:
    """Open the store at file:///folder (created when missing) or s3://bucket/prefix.

    Raises ValueError for any other address: other stores would differ in what is promised.
    """
    parts = urlsplit(url)
    is_folder = (parts.scheme, parts.netloc) == ("file", "") and url.startswith("file:///")
    if not (is_folder or (parts.scheme == "s3" and parts.netloc)):
        raise ValueError("it is like file:///folder or s3://bucket/prefix")
    if set("?#") & set(url):  # what follows would be left out, and another folder be used
        raise ValueError("write ? and # in it as %3F and %23")
    return FolderStorage(Path(url2pathname(parts.path))) if is_folder else BucketStorage(url)
