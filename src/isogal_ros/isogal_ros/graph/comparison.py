"""How a replay's fixes differ from the recorded ones."""

from dataclasses import dataclass

import numpy as np

from isogal.earth.frames import horizontal_difference
from isogal_ros.bags.collect import Collector


@dataclass(frozen=True)
class Comparison:
    """How a replay's fixes differ from the recorded ones."""

    recorded: int
    """Fixes recorded, without those that say there is none."""
    replayed: int
    common: int
    """Stamps at which both gave a fix."""
    disagreements: int | None
    """Stamps at which one gave a fix and the other said there is none, or nothing; None = the
    recording says nothing of any batch, so that there is nothing to compare with."""
    largest_difference: float | None
    """m, between fixes of the same stamp; None = there is none in common."""

    def within(self, tolerance: float) -> bool:
        """Whether there is something to compare with, and no fix differs by more (m)."""
        return self.disagreements == 0 and (self.largest_difference or 0.0) <= tolerance


def compare(recorded: Collector, replayed: Collector, last_ns: int) -> Comparison:
    """Compare the fixes up to a stamp."""
    old = {ns: fix for ns, fix in recorded.fix_positions().items() if ns <= last_ns}
    new = replayed.fix_positions()
    differences = [
        float(np.hypot(*horizontal_difference(*after, *before)))
        for ns, before in old.items()
        if before is not None and (after := new.get(ns)) is not None
    ]
    return Comparison(
        recorded=sum(fix is not None for fix in old.values()),
        replayed=sum(fix is not None for fix in new.values()),
        common=len(differences),
        disagreements=sum((old.get(ns) is None) != (new.get(ns) is None) for ns in {*old, *new})
        if old
        else None,
        largest_difference=max(differences, default=None),
    )
