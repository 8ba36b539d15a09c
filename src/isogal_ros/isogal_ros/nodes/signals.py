"""SIGINT, SIGTERM and SIGHUP in the process of one node: from its first line to its last, an end
without a traceback."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

INTERRUPTED = 130
"""Exit code of a process that was interrupted before it had begun."""
_SIGNALS = [signal.SIGINT, signal.SIGTERM]
if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as under nohup
    _SIGNALS.append(signal.SIGHUP)


def end_quietly(program: str, module: str | None = None) -> None:
    """End this process at once when a signal comes, if it is that of a program (or of its module,
    by default ``<program>.node``): until all is imported there is nothing to end in good order,
    and nobody wants to read where it was. There is no garbage, either: to search for some would be
    an eighth of the time (`isogal_ros.nodes.spin.run_node` begins with it)."""
    words = [Path(sys.argv[0]).name if sys.argv else "", *sys.orig_argv[1:3]]
    if program in words or (module or f"{program}.node") in words:
        end_at_once()
        gc.disable()


def end_at_once() -> None:
    """End this process at once when a signal comes."""
    for number in _SIGNALS:
        signal.signal(number, lambda *_: os._exit(INTERRUPTED))


class Interrupt:
    """True once such a signal came."""

    def __init__(self) -> None:
        self.count = 0
        self.ends_at_once = False
        """Whether a signal raises KeyboardInterrupt, too."""
        self.told: Callable[[], None] = lambda: None
        """Called when one comes."""

    def __bool__(self) -> bool:
        return self.count > 0

    def __call__(self, _number: int, _frame: FrameType | None = None) -> None:
        """Handle a signal."""
        self.count += 1
        self.told()
        if self.ends_at_once:
            # where compiled code is interrupted, Python would print what it cannot raise
            sys.unraisablehook = lambda _: None
            raise KeyboardInterrupt


@contextmanager
def interrupts() -> Iterator[Interrupt]:
    """Note signals instead of ending at once, so that what was published arrives before the
    process ends."""
    interrupt = Interrupt()
    old = {number: signal.signal(number, interrupt) for number in _SIGNALS}
    try:
        yield interrupt
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
