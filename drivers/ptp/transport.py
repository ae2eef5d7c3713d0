"""What a PTP session needs of a cable or a network."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.ptp.containers import Bytes, Container

ANSWER_S = 10.0
"""How long one waits for a camera's answer."""

DATASET_BYTES = 1 << 20
"""No dataset is larger."""

SLOWEST_BYTES_PER_S = 50_000
"""Data that come more slowly are given up."""


class Transport(ABC):
    """Carries containers to a camera and back.

    Every method raises CameraDisconnectedError once the camera is gone.
    """

    @abstractmethod
    def send(self, container: Container) -> None:
        """Send a command or its data."""

    @abstractmethod
    def receive(self, most: int = DATASET_BYTES, into: memoryview | None = None) -> Container:
        """Take the next data or response container.

        most: bytes of data that there can be. into: where data are put if they fit, the payload is
        then a part of it; it is as large as what was asked for. Raises ProtocolError for malformed
        bytes, CameraTimeoutError where nothing comes.
        """

    @abstractmethod
    def receive_event(self, timeout_s: float) -> Container | None:
        """Take the next event, waiting at most timeout_s seconds; None if there is none."""

    def start_afresh(self) -> bool:
        """Throw away what is still on the way of a transaction that was cut off, before closing.

        Whether the session must then be closed; false where it ends with the connection.
        """
        return False

    @abstractmethod
    def close(self) -> None:
        """Let go of the connection. Closing twice is fine."""


def data_s(most: int, into: memoryview | None) -> float:
    """How long data may take beyond their answer, in seconds: by what was asked for, if told."""
    return (most if into is None else len(into)) / SLOWEST_BYTES_PER_S


def put(payload: Bytes, into: memoryview | None) -> Bytes:
    """Copy data to where they are wanted, for transports that cannot receive them there."""
    if into is None or len(payload) > len(into):
        return payload
    into[: len(payload)] = payload
    return into[: len(payload)]
