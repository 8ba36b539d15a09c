"""When batches of several fields end: their readings are of one navigator, and are matched
together."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.scenario import Assumed


@dataclass(frozen=True, slots=True)
class UpdateSchedule:
    """When batches end."""

    lead: int
    """The field whose batch ends are everybody's."""
    times: tuple[float, ...]
    """Of each field the time between its fixes if it were alone, s."""

    @classmethod
    def of(cls, scenarios: Sequence[Assumed]) -> "UpdateSchedule":
        """Return that of fields, by what is assumed of each (`Assumed.each_field`)."""
        times = tuple(
            one.matcher.scans_between_fixes * one.gravimeter.interval for one in scenarios
        )
        return cls(int(np.argmin(times)), times)

    def marks(self, field: int, assumed: Assumed) -> int:
        """Return how many batch ends there are at most in a batch of a field."""
        if field == self.lead:
            return 0
        length = assumed.matcher.batch_length * assumed.gravimeter.interval
        return math.ceil(length / self.times[self.lead]) + 1
