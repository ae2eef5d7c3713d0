"""What can be made to go wrong with the simulated camera, to rehearse it."""

from __future__ import annotations

from typing import Literal

Fault = Literal[
    "none",
    # the driver gets over these
    "busy_briefly",  # the first releases are refused
    "lost_events",
    "late_events",  # told only with the next photograph
    "broken_transfer",  # every other chunk breaks off
    "short_packets",  # everything comes in small pieces; on a cable or network
    "glued_packets",  # data and response come in one piece; on a cable or network
    "stall",  # the endpoint halts before the answer to every release; on a cable
    "slow_link",
    "asleep",  # the first connection gets no answer
    "flash_not_ready",  # the flash has no charge for its first photograph
    # and not over these
    "busy",  # every release is refused
    "focus",  # the release finds no focus
    "store_full",
    "no_photograph",  # released, but nothing reaches the card
    "silent",  # no answer to the release
    "garbled",  # nonsense for an answer to the release
    "hostile",  # lists that say they are endless
    "unplug",  # in the transfer of a photograph
    "truncated",  # the card holds half of what it says
    "huge_size",  # a photograph says that it has 4 GB
    "flash_dead",
    "flash_always",
    "flash_locked",  # its mode can only be set on the camera
    "auto_exposure",  # the flash frame gets half the time
]
