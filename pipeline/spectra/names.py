"""Names as people and cameras write them, brought to one form."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable

_NEAR = 4  # names that are listed at most
_LONGEST = 256  # characters that are looked at: no file's name has more, and anybody may send many
_NOISE = {"corporation", "corp", "co", "ltd", "inc", "company", "imaging", "eos", "npl"}


def key_of(name: str) -> str:
    """Letters and digits of a name, without case, firm's suffixes and repeated words.

    Those of any script among its first 256 characters, in the form NFKC of Unicode. "NIKON
    CORPORATION NIKON D5100" and "Nikon D5100" have the same key. A name without any has the key
    "", which finds nothing.
    """
    words = re.findall(r"[^\W_]+", unicodedata.normalize("NFKC", name[:_LONGEST]).casefold())
    return "".join(dict.fromkeys(word for word in words if word not in _NOISE))


def near_names(name: str, known: Iterable[str]) -> list[str]:
    """Return the known names nearest to a name, best first, at most four."""
    by_key = {key_of(candidate): candidate for candidate in known}
    return [by_key[key] for key in difflib.get_close_matches(key_of(name), by_key, _NEAR, 0.5)]


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """Sentence that says a name is unknown and lists near ones."""
    near = near_names(name, known)
    hint = f"near names are {', '.join(near)}" if near else "send its table instead"
    return f"No {what} is called {name[:80]!r}: {hint}."
