"""Memory that a node does not need any more goes back to the system.

A listener that stops for a while leaves megabytes of messages with the node that writes to it. The
middleware frees them when they have been taken (`graph/fastdds.xml`), but the C library keeps what
lies below the last block in use."""

import ctypes
import time

EVERY = 5.0
"""s of wall time."""


class Memory:
    """Gives back what is free, now and then; where the C library is not glibc, nothing."""

    def __init__(self) -> None:
        self._trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        self._last = time.monotonic()

    def give_back(self) -> bool:
        """Give back what is free if it is time to; return whether it was."""
        if self._trim is None or time.monotonic() - self._last < EVERY:
            return False
        self._last = time.monotonic()
        self._trim(ctypes.c_size_t(0))
        return True
