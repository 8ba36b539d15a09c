"""Publishers of one topic, kept apart: the first one heard is used while it is there."""

from collections.abc import Callable

Look = Callable[[], dict[bytes, str]]
"""Returns the publishers that are there: what identifies each, and its node's name."""

NAMELESS = "a node without a name yet"


class Sources:
    """Says of each message whether it is of the publisher that is used.

    Another one takes over when that one is gone; so does at once one of a node of the same name
    that has come since, unless the first is heard beside it: of a process that was killed the
    middleware takes up to 20 s to notice that it is gone, and its successor is not to wait.

    Parameters
    ----------
    look : callable
        See `Look`.
    """

    def __init__(self, look: Look) -> None:
        self._look = look
        self._there: dict[bytes, str] = {}
        self._used: bytes | None = None
        self._before: bytes | None = None
        """Whom the one that is used has succeeded, although it seems to be there still."""
        self._beside: set[bytes] = set()
        """Those beside which the one that is used has been heard: they do not succeed it."""

    def look(self) -> None:
        """See anew who is there."""
        self._there = self._look()
        self._beside &= self._there.keys()

    def refuse(self, gid: bytes, alone: bool) -> str | None:
        """Take a message of a publisher; return why it is not to be used (None = it is).

        Parameters
        ----------
        gid : bytes
            What identifies the publisher.
        alone : bool
            Whether there is only one publisher now.
        """
        if gid not in self._there or (gid != self._used and not self._succeeds(gid)):
            self.look()
        if gid == self._used:
            self._beside |= self._there.keys() - {gid}
        elif gid == self._before and self._used is not None:
            self._beside.add(self._used)
            self._used, self._before = gid, None
        elif self._used is None or alone or self._succeeds(gid):
            seems_there = not alone and self._used in self._there
            self._before = self._used if seems_there else None
            self._used = gid
        else:
            return f"of a second publisher, {self._other(gid)}: {self._name(self._used)} is used"
        return None

    def _succeeds(self, gid: bytes) -> bool:
        if self._used not in self._there:
            return True
        may_be = self._there.get(gid, NAMELESS) in (NAMELESS, self._there[self._used])
        return may_be and gid not in self._beside

    def _other(self, gid: bytes) -> str:
        name = self._name(gid)
        return f"another {name}" if name == self._name(self._used) else name

    def _name(self, gid: bytes | None) -> str:
        return self._there.get(gid or b"", NAMELESS)

    @property
    def several(self) -> str | None:
        """That there are others than the one that is used; None = there are none."""
        others = {
            self._other(gid)
            for gid in self._there
            if gid != self._used and not self._succeeds(gid)
        }
        if self._used not in self._there or not others:
            return None
        return f"published by {', '.join(sorted(others))}, too: {self._name(self._used)} is used"
