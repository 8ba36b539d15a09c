"""How far a run is, as whoever watches it is told."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

INTERVAL = 0.2
"""s of wall time between reports."""


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    simulated: float
    """s."""
    duration: float
    """s."""
    speed: float
    """Simulated seconds per second of wall time."""
    position_error: float
    """m; NaN = not known."""


Report = Callable[[Progress], None]


def progress_of(figures: Mapping[str, Any]) -> Progress | None:
    """Return the progress that ins_sim_node's figures tell; None before the first step."""
    if "simulated" not in figures:
        return None
    names = ("simulated", "duration", "speed", "position error")
    return Progress(*(float(figures[name]) for name in names))


class ReportTimer:
    """Says when it is time to report again."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def due(self) -> bool:
        """Whether `INTERVAL` has passed since it last was."""
        if (now := time.monotonic()) - self._last < INTERVAL:
            return False
        self._last = now
        return True
