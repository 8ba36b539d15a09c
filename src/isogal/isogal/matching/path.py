"""Where the navigator was, between scans: for readings that are late (docs/mathematics.md, section
4.7)."""

from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.sensors.lag import Lag, low_pass
from isogal.sensors.reduction import Reduction, State

_STEP = 1.0
"""s, in which reductions are filtered as the readings were."""
_LEAST_WEIGHT = 1e-4
"""Of a node of the path: what those of less weight change of a reading is less than 1e-5 of how
the field differs along it."""


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
        of_north = hermite(flat, self.time, self.latitude, self.velocity[:, 0] / north)
        of_east = hermite(flat, self.time, self.longitude, self.velocity[:, 1] / east)
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


@dataclass(frozen=True, slots=True, eq=False)
class FilterPath:
    """Where the vehicle was while an instrument's filter took in a reading."""

    filter_time: float
    """s."""
    away: Array
    """(T, K, 2) m north and east of the row's place."""
    weight: Array
    """(K,), sum 1."""

    def nodes(self, latitude: Array) -> Array:
        """Return (T, Q, 3) what a kernel looks up instead of places at latitudes (T,) (rad):
        latitude and longitude beside them (rad), and weight."""
        counts = self.weight > _LEAST_WEIGHT
        weight = np.broadcast_to(self.weight[counts], (len(latitude), counts.sum()))
        away, scale = self.away[:, counts], np.stack(metres_per_radian(latitude), axis=-1)
        parts = [away / scale[:, None], weight[..., None] / weight[0].sum()]
        return np.ascontiguousarray(np.concatenate(parts, axis=-1))  # else compiled once more

    def part(self, rows: Integers) -> "FilterPath":
        """Return that of some of the rows, by their indices."""
        return replace(self, away=self.away[rows])


def sensed(
    path: Path, times: Array, reading: Array, lag: Lag, reduction: Reduction
) -> tuple[State, Array, FilterPath | None]:
    """Return the states (T,) at the mean time that each late reading was sensed, the readings (T,)
    reduced with the navigator's states of then, and what of the path they are a mean over (None =
    a point).

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
    reading = reading + np.interp(times - lag.delay, fine, then) - now
    if lag.filter_time == 0.0:
        return at, reading, None
    ages, weight = lag.ages()
    sensed_at = path.at(times[:, None] - ages)
    away = horizontal_difference(
        sensed_at.latitude,
        sensed_at.longitude,
        np.asarray(at.latitude)[:, None],
        np.asarray(at.longitude)[:, None],
    )
    return at, reading, FilterPath(lag.filter_time, away, weight)
