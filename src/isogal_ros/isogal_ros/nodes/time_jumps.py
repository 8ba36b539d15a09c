"""Stamps that jump ahead: of one message a fault, of several a gap."""

from isogal_ros.messages.checks import BadMessageError


class TimeJumps:
    """Holds a message whose stamp jumps ahead back until the next one says that time has passed: a
    single wrong stamp would make the filter bridge hours, and have all messages after it refused.

    Parameters
    ----------
    longest : int
        Longest gap that is believed at once, ns.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._held: int | None = None

    def check(self, ns: int, newest: int) -> None:
        """Look at a stamp after the newest that was used; raises BadMessageError where it has to
        wait for the next."""
        if ns - newest <= self._longest:
            self._held = None
            return
        held, self._held = self._held, ns
        if held is None or not 0 < ns - held <= self._longest:
            raise BadMessageError(
                f"stamp is {(ns - newest) / 1e9:.0f} s ahead; used if the next one is, too"
            )
