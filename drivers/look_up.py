"""An event loop that can leave the look-up of a host's name behind: nothing cuts one short."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable
from typing import Any


class LookUpLoop(asyncio.SelectorEventLoop):
    """Looks names up in threads that neither its end nor the interpreter's waits for."""

    async def getaddrinfo(self, *asked: Any, **more: Any) -> Any:
        """Give what socket.getaddrinfo gives, and raise what it raises."""
        found = self.create_future()

        def look_up() -> None:
            try:
                tell: Callable[[Any], None] = found.set_result
                told: Any = socket.getaddrinfo(*asked, **more)
            except Exception as error:
                tell, told = found.set_exception, error

            def hand_over() -> None:
                if not found.done():  # it is cancelled where nobody waits any more
                    tell(told)

            with contextlib.suppress(RuntimeError):  # the loop has been closed meanwhile
                self.call_soon_threadsafe(hand_over)

        threading.Thread(target=look_up, daemon=True).start()
        return await found
