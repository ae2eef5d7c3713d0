"""What can go wrong with a pair of photographs.

PipelineError
├── InputError            the request or its files cannot be used; the user can mend it
│   ├── UnreadableImageError   not an image we read, or a damaged one
│   ├── ImageTooLargeError     more pixels than the limit
│   ├── PairMismatchError      the two frames do not belong together
│   ├── UnusablePairError      no light left to separate (black, identical, flash too weak)
│   │   └── SwappedPairError   each frame seems to be the other one
│   ├── MarkError              what is to be measured was not found, or more than once
│   └── OptionError            an option's value cannot be used
└── Canceled              the caller asked to stop

Each message is one sentence for people: what, where, and what to do.
"""

from __future__ import annotations


class PipelineError(Exception):
    """Root of everything the pipeline raises on purpose."""


class InputError(PipelineError):
    """The request or its files cannot be used."""


class UnreadableImageError(InputError):
    """The bytes are not an image that can be read."""


class ImageTooLargeError(InputError):
    """The image has more pixels than the limit."""


class PairMismatchError(InputError):
    """The two frames do not belong together."""


class UnusablePairError(InputError):
    """The pair holds no light that could be separated."""


class SwappedPairError(UnusablePairError):
    """Each of the frames seems to be the other one."""


class MarkError(InputError):
    """What a calibration measures was not found in the photographs, or more than once."""


class OptionError(InputError):
    """An option has a value that cannot be used."""


class Canceled(PipelineError):  # noqa: N818  a request, not an error
    """The caller asked to stop."""


def own_words(message: str) -> str:
    """Leave out what pydantic puts before a sentence of ours."""
    return message.replace("Value error, ", "")


def reason_of(error: OSError) -> str:
    """Say in a few words why a file, a folder or a port cannot be used."""
    return (error.strerror or "unknown reason").lower()


def counted(count: int, one: str, more: str) -> str:
    """Say how many there are: "1 job waits" of "job waits" and "jobs wait"."""
    return f"{count} {one if count == 1 else more}"
