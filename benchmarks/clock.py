"""Where the time goes: what calls of functions take, each without the calls inside it."""

from collections import defaultdict
from collections.abc import Callable
from time import thread_time
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Clock:
    """Seconds and calls by name; `now` is read at the begin and the end of every call."""

    def __init__(self, now: Callable[[], float] = thread_time) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, list[float]] = defaultdict(list)
        """What each call took with those inside it, s."""
        self._now, self._since = now, 0.0
        self._open: list[str] = []

    def timed(self, name: str, function: Callable[P, T]) -> Callable[P, T]:
        """Return a function that is timed."""

        def run(*values: P.args, **named: P.kwargs) -> T:
            begun = self._turn()
            self._open.append(name)
            try:
                return function(*values, **named)
            finally:
                self.calls[name].append(self._turn() - begun)
                self._open.pop()

        return run

    def watch(self, name: str, owner: object, attribute: str) -> None:
        """Time a function of a module or class from now on."""
        setattr(owner, attribute, self.timed(name, getattr(owner, attribute)))

    def _turn(self) -> float:
        """Give the time since the last turn to the innermost call that is open."""
        now = self._now()
        if self._open:
            self.seconds[self._open[-1]] += now - self._since
        self._since = now
        return now
