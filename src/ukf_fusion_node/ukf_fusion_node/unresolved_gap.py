"""What is not known after a long gap in the IMU's samples.

The filter goes on as if the vehicle had made no manoeuvre in it, or one of the size that it was
set to expect (`isogal.fusion.outage`). A sharper turn is neither, and one heading error suits a
few fixes as well as another: the first that contradict it may come after minutes."""

TEXT = "samples were missing for long: whether there was a sharp manoeuvre is for fixes to say"


class UnresolvedGap:
    """Lasts until fixes have agreed with the navigator for a time.

    Parameters
    ----------
    settles : int
        How long, ns.
    """

    def __init__(self, settles: int) -> None:
        self._settles = settles
        self._since: int | None = None

    def begin(self, ns: int) -> None:
        """Note a gap that ended at a stamp."""
        self._since = ns

    def renew(self, ns: int) -> None:
        """Note that a fix did not agree; without a gap that is no matter of this."""
        if self._since is not None:
            self._since = ns

    def text(self, ns: int, undecided: bool) -> str | None:
        """Say it, at a stamp; None = there is nothing unresolved any more.

        Parameters
        ----------
        undecided : bool
            Whether the filter itself leaves it open.
        """
        if self._since is not None and ns - self._since > self._settles and not undecided:
            self._since = None
        return None if self._since is None else TEXT
