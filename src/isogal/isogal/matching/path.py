"""Where the navigator was, between scans: for readings that are late (docs/mathematics.md, section
4.7)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.sensors.lag import Lag, low_pass
from isogal.sensors.reduction import Reduction, State

_STEP = 1.0
"""s, in which reductions are filtered as the readings were."""


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """The navigator's states at N increasing times."""

    time: Array
    """(N,) s."""
    latitude: Array
    """(N,) rad."""
    longitude: Array
    """(N,) rad."""
    height: Array
    """(N,) m."""
    velocity: Array
    """(N, 2) m/s, north and east."""

    def at(self, time: Array) -> State:
        """Return the states at other times, of their shape: cubic between two scans by positions
        and velocities there, straight before the first and after the last."""
        north, east = metres_per_radian(self.latitude)
        flat, shape = np.ravel(time), np.shape(time)
        known = np.ascontiguousarray(self.time)  # as a column of a table it would be compiled anew
        of_north = hermite(flat, known, self.latitude, self.velocity[:, 0] / north)
        of_east = hermite(flat, known, self.longitude, self.velocity[:, 1] / east)
        latitude, by_north = (part.reshape(shape) for part in of_north)
        longitude, by_east = (part.reshape(shape) for part in of_east)
        north, east = metres_per_radian(latitude)
        height = np.interp(time, self.time, self.height)
        return State(latitude, longitude, height, by_north * north, by_east * east)


@kernel
def hermite(time: Array, known: Array, value: Array, slope: Array) -> tuple[Array, Array]:
    """Return at times (N,) what has values (T,) and slopes at known times, cubic in between and
    straight before and after, and its slopes."""
    out, by_time, last = np.empty(len(time)), np.empty(len(time)), len(known) - 1
    for k in range(len(time)):
        i = min(max(np.searchsorted(known, time[k], side="right") - 1, 0), max(last - 1, 0))
        step = known[i + 1] - known[i] if last > 0 else 1.0
        j = min(i + 1, last)
        u = (time[k] - known[i]) / step
        inside = min(max(u, 0.0), 1.0) if last > 0 else 0.0
        a, b = inside * inside * (3.0 - 2.0 * inside), inside * (1.0 - inside)
        cubic = (1.0 - a) * value[i] + a * value[j]
        cubic += step * b * ((1.0 - inside) * slope[i] - inside * slope[j])
        change = 6.0 * b * (value[j] - value[i]) / step + (1.0 - inside - 3.0 * b) * slope[i]
        by_time[k] = change + (inside - 3.0 * b) * slope[j]
        out[k] = cubic + by_time[k] * step * (u - inside)
    return out, by_time


def sensed(
    path: Path, times: Array, reading: Array, lag: Lag, reduction: Reduction
) -> tuple[State, Array]:
    """Return the states (T,) at the mean time that each late reading was sensed, and the readings
    (T,) reduced with the navigator's states of then.

    Parameters
    ----------
    times, reading : (T,) arrays
        Stamps, and readings as reduced with the state at the stamp. Reductions add to a reading
        what depends on the state alone.
    """
    at = path.at(times - lag.mean)
    now = reduction.reduce(np.zeros(len(times)), path.at(times))
    fine = np.arange(times[0] - lag.reach, times[-1] + _STEP, _STEP)
    then = low_pass(reduction.reduce(np.zeros(len(fine)), path.at(fine)), _STEP, lag.filter_time)
    return at, reading + np.interp(times - lag.delay, fine, then) - now
