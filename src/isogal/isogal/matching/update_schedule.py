"""When batches of several fields end: their readings are of one navigator, and are matched
together."""

from collections.abc import Sequence

import numpy as np

from isogal.scenario import Assumed


def time_between_fixes(assumed: Assumed) -> float:
    """Return the time between the fixes of a field if it were alone, s."""
    return assumed.matcher.scans_between_fixes * assumed.gravimeter.interval


def leading_field(each: Sequence[Assumed]) -> int:
    """Return which of the fields of a scenario (`Assumed.each_field`) says when batches end, for
    all of them: that with the least time between its fixes."""
    return int(np.argmin([time_between_fixes(one) for one in each]))
