"""When the navigator's position must not be sent: before it is aligned, and from the first word of
the matcher that the navigator has diverged until it has been told where it is."""

LIKELY = 0.5
"""Probability from which on the navigator is taken to be somewhere else."""


class Silence:
    """Follows what the matcher says of each batch, and the navigator's answers."""

    def __init__(self) -> None:
        self._lost = self._found = False
        self._elsewhere, self._aligned = False, False
        self._fixed: int | None = None
        self.resets = 0
        """How often the position has jumped to another place."""

    @property
    def why(self) -> str | None:
        """Why nothing may be sent; None = it may."""
        if self._lost or self._elsewhere:
            return "the navigator has diverged"
        return None if self._aligned else "the navigator is not aligned"

    def batch(self, lost: bool, published: bool) -> None:
        """Take what a batch says: that the navigator was lost, and that there is a fix."""
        self._lost = self._lost or lost
        self._found = self._lost and published

    def probability(self, elsewhere: float) -> None:
        """Take how probable it is that the navigator is at another place."""
        self._elsewhere = elsewhere > LIKELY

    def fix(self, ns: int, aligned: bool) -> None:
        """Take the stamp of a message on nav/fix, the second of which is after a fix, and whether
        it says that the navigator is aligned."""
        self._aligned = aligned
        if ns == self._fixed and self._found:
            self._lost = self._found = False
            self.resets += 1
        self._fixed = ns
