"""A second smoothing pass, by the readings themselves.

A navigator that was found to be lost has been so since the start, and was given fixes of wrong
places. Afterwards its place is known, and by the inertial data where it was before: the voyage is
navigated once more from a start that is as uncertain as it was found to be, with each reading as a
measurement that is linear about the smoothed track, the map's error and those of the instrument as
auxiliary states, and smoothed; and so on until the track stays (iterated posterior linearisation
smoother: García-Fernández, Svensson & Särkkä 2017; docs/mathematics.md, section 3.18)."""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.earth.frames import horizontal_difference
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.clone import NO_CLONE
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import OF_FIXES, Measurement
from isogal.fusion.measurements.map_reading import MapReading, linear_map
from isogal.fusion.segment import AT_ONCE
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH
from isogal.inertial.rotations import matrix
from isogal.maps.tiled_map import ScalarMap
from isogal.sensors.reduction import Reduction, State

ITERATIONS = 8
"""At most."""
SETTLED = 0.05
"""1-sigmas by which the track may still move."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """All readings of a field."""

    time: Array
    """(K,) s."""
    sensed: Array
    """(K,) as the instrument gave them; NaN = none."""
    reduction: Reduction
    field_map: ScalarMap
    variance: float
    """Of the white noise, rounding of the map included."""
    errors: tuple[AuxiliaryState, ...]
    """Slow errors: of the map, of the instrument."""

    def measurements(self, states: Sequence[FilterState]) -> list[MapReading | None]:
        """Return the readings about states (K) that are known beforehand; None where there is no
        reading, or no map."""
        place = np.array([state.position for state in states])
        velocity = np.array([state.velocity for state in states])
        covariance = np.array([state.covariance[:2, :2] for state in states])
        attitude = matrix(np.array([state.attitude for state in states]))
        latitude, longitude, height = place.T
        at = State(latitude, longitude, height, velocity[:, 0], velocity[:, 1], attitude)
        reduced = np.asarray(self.reduction.reduce(self.sensed, at))
        jacobian, by_height = self.reduction.jacobian(at), self.reduction.height_slope(at)
        value, slope, left = linear_map(self.field_map, latitude, longitude, covariance)
        residual, variance = reduced - value, self.variance + left
        by_error = np.column_stack([slope - jacobian[:, :2], by_height, -jacobian[:, 2:]])
        reference = np.column_stack([place, velocity[:, :2]])
        contents = [one.name for one in self.errors]
        each = zip(reference, residual.tolist(), by_error, variance.tolist(), strict=True)
        exists = np.isfinite(residual) & np.isfinite(variance)
        return [
            MapReading(*one, contents) if is_there else None
            for one, is_there in zip(each, exists, strict=True)
        ]


def smoothed_by_readings(
    navigator: InertialNavigator,
    readings: Sequence[Readings],
    time: Array,
    lost: Array,
    since: float,
) -> list[FilterState]:
    """Return the states at times (K,), s, rising, as all readings have them.

    Parameters
    ----------
    navigator : InertialNavigator
        With the whole history; it is not changed.
    readings : sequence of Readings
        Of each field.
    time : (K,) array
    lost : (7, 7) array
        What the covariance of the start, of a batch's states, grows by: the navigator was found to
        be lost.
    since : float
        s, from when on its track is that of the vehicle.
    """
    every = np.unique(np.concatenate([np.asarray(time, float), *(one.time for one in readings)]))
    track, known = navigator.smoothed(every), every >= since
    for _ in range(ITERATIONS):
        new = navigated(navigator, readings, every, track, known, lost).smoothed(every)
        settled = known.all() and _moved(new, track) < SETTLED
        track, known = new, np.ones_like(known)
        if settled:
            break
    return [track[k] for k in np.searchsorted(every, time).tolist()]


def navigated(
    navigator: InertialNavigator,
    readings: Sequence[Readings],
    time: Array,
    track: Sequence[FilterState],
    known: Booleans | None = None,
    lost: Array | None = None,
) -> InertialNavigator:
    """Return a navigator that has had what another one has had, but readings instead of fixes.

    Parameters
    ----------
    navigator : InertialNavigator
        With the whole history; it is not changed.
    readings : sequence of Readings
        Of each field.
    time : (K,) array
        s, rising, with the times of all readings.
    track : sequence of K FilterState
        States about which readings are linear.
    known : (K,) array of bool, optional
        Which of these states readings may be linear about; default: all.
    lost : (7, 7) array, optional
        See `smoothed_by_readings`.
    """
    measured: dict[float, list[Measurement]] = defaultdict(list)
    for one in readings:
        where = np.searchsorted(time, one.time)
        made = one.measurements([track[k] for k in where.tolist()])
        for k, stamp, reading in zip(where.tolist(), one.time.tolist(), made, strict=True):
            if reading is not None and (known is None or known[k]):
                measured[stamp].append(reading)
    again = _again(navigator, readings, lost)
    segments = navigator.history(np.array(sorted(measured)))
    ends = [segment.end for segment in segments]
    of_segment = {bisect_left(ends, at - AT_ONCE): those for at, those in measured.items()}
    for index, segment in enumerate(segments[1:], 1):
        samples = segment.time, segment.force, segment.rate, segment.height
        again.imu(*samples, segment.missing)
        others = [one for one in segment.measurements if not isinstance(one, OF_FIXES)]
        for measurement in (*others, *of_segment.get(index, ())):
            again.measure(segment.end, measurement)
    return again


def _again(
    navigator: InertialNavigator, readings: Sequence[Readings], lost: Array | None
) -> InertialNavigator:
    """Return a navigator at the start of the history, with the readings' errors as states, which
    knows what has been learnt of the gravity map and of aids."""
    errors = tuple(state for one in readings for state in one.errors)
    model, newest = navigator.model, navigator.state
    first = navigator.history(np.empty(0))[0]
    before, size = first.after.merged, model.states
    variance = np.diag([one.sigma**2 for one in errors])
    covariance = np.zeros((size + len(errors),) * 2)
    covariance[:size, :size], covariance[size:, size:] = before.covariance, variance
    if lost is not None:
        covariance[np.ix_(BATCH, BATCH)] += lost
    learnt = newest.residual_gravity
    for at, one in enumerate(model.auxiliary, size - len(model.auxiliary)):
        if one.enters == "gravity" and learnt[0] > 0.0:
            covariance[at, at] = max(covariance[at, at], learnt[0] ** 2)
    start = replace(
        before.copy(),
        auxiliary=np.concatenate([before.auxiliary, np.zeros(len(errors))]),
        covariance=covariance,
        residual_gravity=learnt.copy(),
        clone=NO_CLONE,
        contradicted=newest.contradicted,
    )
    with_errors = replace(model, auxiliary=(*model.auxiliary, *errors))
    sample = first.force[-1], first.rate[-1]
    return InertialNavigator(with_errors, start, first.end, np.inf, navigator.motion, sample)


def _moved(states: Sequence[FilterState], before: Sequence[FilterState]) -> float:
    """Return how far states have moved at most, in their 1-sigmas."""
    largest = 0.0
    for one, other in zip(states, before, strict=True):
        apart = np.asarray(horizontal_difference(*one.position[:2], *other.position[:2]))
        largest = max(largest, float(apart @ np.linalg.solve(one.covariance[:2, :2], apart)))
    return largest**0.5
