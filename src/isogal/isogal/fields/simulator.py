"""Simulated readings of a scalar field: the map as truth, its error, and the sensor's noise,
outliers, bias and drift."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.fields.beams import simulate_soundings
from isogal.fields.magnetic_vehicle import (
    MAGNETOMETER,
    Vehicle,
    assumed_compensation,
    simulate_vehicle,
)
from isogal.fields.map_error import TrueMapError
from isogal.fields.measured import MeasuredField, measured_field, of_instrument
from isogal.fields.recorded_readings import Recorded, recorded_scans
from isogal.fields.scenario_map import true_map
from isogal.inertial.rotations import matrix
from isogal.magnetics.terms import terms
from isogal.maps.channels import RouteMap
from isogal.maps.load import check_coverage
from isogal.scenario import Assumed, Map, Settings, Truth
from isogal.sensors.gravimeter_errors import missing, reading_errors
from isogal.sensors.lag import Lag
from isogal.sensors.noise import RunScans
from isogal.sensors.satellites import turn_rates
from isogal.sensors.trajectory import Trajectory

ALTIMETER = "altimeter"
"""Instrument that may have several beams."""


class ReadingSimulator:
    """Readings of R runs at every scan of a route; scan j is taken at the end of IMU interval (j +
    1) * steps_per_scan.

    Parameters
    ----------
    truth : Truth
        Of one field.
    trajectory : Trajectory
    field_map : RouteMap
        Of what the instrument measures; the truth differs from it by the map's error.
    runs : sequence of int
        They seed the random streams.

    Raises
    ------
    InputError
        See `true_readings`.
    """

    def __init__(
        self, truth: Truth, trajectory: Trajectory, field_map: RouteMap, runs: Sequence[int]
    ) -> None:
        self._truth, self._trajectory, self._map, self._runs = truth, trajectory, field_map, runs
        self.index = i = scan_index(truth, trajectory)
        """(scans,) index into the trajectory of each scan."""
        self.time = trajectory.time[i]
        """(scans,) s, of each reading."""
        if truth.readings.recorded:
            found = recorded(truth, trajectory)
            self.time, sensed = found.time, np.tile(found.value, (len(runs), 1))
        else:
            sensed = self._simulated(_measured(truth, field_map))
        for row, run in enumerate(runs):
            scans = RunScans(truth.seed, run, trajectory, i)
            sensed[row, missing(truth.gravimeter, scans)] = np.nan
        self.raw = sensed
        """(R, scans) raw readings, NaN = none; (R, scans, C) of a field with C channels, (R,
        scans, B, 3) of an altimeter with B beams."""

    def _simulated(self, field: MeasuredField) -> Array:
        truth = self._truth
        several = field.instrument == ALTIMETER and truth.altimeter.sounds
        sensed = self._soundings() if several else self._readings(field)
        return field.reduction(truth).report(sensed)

    def _readings(self, field: MeasuredField) -> Array:
        truth, trajectory, runs, i = self._truth, self._trajectory, self._runs, self.index
        perfect = true_readings(truth, trajectory, self._map)
        size = perfect.shape[1:]
        map_error = TrueMapError(truth, trajectory, i, runs)
        if field.name == "gradient" and truth.gradiometer.of_one_potential:
            sensed = perfect + field.sign * map_error.of_one_potential()
        else:
            sensed = perfect + field.sign * map_error.at_scans(size)
        if Lag.of(truth.gravimeter).mean > 0.0:
            sensed = _late(map_error, self._map, sensed)
        sensed = sensed + field.sign * map_error.of_datum(size)
        scans = [RunScans(truth.seed, run, trajectory, i) for run in runs]
        errors = [
            reading_errors(truth.gravimeter, one)
            if field.channels is None
            else field.channels.errors(truth, one, felt)
            for one, felt in zip(scans, sensed, strict=True)
        ]
        sensed = sensed + np.stack(errors)
        if field.instrument == MAGNETOMETER and truth.magnetometer.aircraft.magnetic:
            sensed = sensed + self.vehicle.added[i]
        return sensed

    def _soundings(self) -> Array:
        truth, trajectory, runs, i = self._truth, self._trajectory, self._runs, self.index
        slow = truth.gravimeter.model_copy(update={"sigma": 0.0})
        errors = [reading_errors(slow, RunScans(truth.seed, run, trajectory, i)) for run in runs]
        map_error = TrueMapError(truth, trajectory, i, runs)
        return simulate_soundings(map_error, self._map, np.stack(errors) - map_error.of_datum())

    @cached_property
    def vehicle(self) -> Vehicle:
        """What a magnetic vehicle adds to the readings, and what its vector magnetometer senses,
        at every step of the trajectory; raises InputError as `true_readings` does."""
        every = np.arange(len(self._trajectory) + 1)
        total = true_readings(self._truth, self._trajectory, self._map, every)
        return simulate_vehicle(self._truth, self._trajectory, total, self._runs)


def compensated(assumed: Assumed, trajectory: Trajectory, readings: ReadingSimulator) -> Array:
    """Return (R, scans) simulated raw readings less what a scenario says that the vehicle adds to
    them, by the vector magnetometer; the raw readings where it says nothing. Where the matcher
    estimates what is left, (R, scans, 1 + C) with the terms of each reading.

    Raises
    ------
    InputError
        The file of coefficients cannot be read, or `true_readings` refuses the map.
    """
    compensation, sensed = assumed_compensation(assumed), readings.raw
    if compensation is None:
        return sensed
    i, vector = readings.index, readings.vehicle.vector
    rate = (vector[:, i] - vector[:, i - 1]) / trajectory.dt
    clean = sensed - compensation.one(vector[:, i], rate, sensed)
    if not assumed.magnetometer.online:
        return clean
    return np.concatenate([clean[..., None], terms(vector[:, i], rate, sensed)], axis=-1)


def true_readings(
    truth: Truth,
    trajectory: Trajectory,
    field_map: RouteMap,
    index: Integers | None = None,
) -> Array:
    """Return what a perfect instrument measures at each scan, (scans,) or (scans, C), with the map
    as the truth.

    Parameters
    ----------
    truth : Truth
        Of one field.
    trajectory : Trajectory
    field_map : RouteMap
    index : (scans,) array, optional
        Other places of the trajectory than those of the scans.

    Raises
    ------
    InputError
        The route ends before the first scan, the map does not cover it, the instrument does not
        measure its quantity, or no such instrument can be there.
    """
    i = scan_index(truth, trajectory) if index is None else index
    if not len(i):
        raise InputError(
            f"scenario: route: takes {trajectory.time[-1]:g} s, and the first reading comes after"
            f" {truth.steps_per_scan * trajectory.dt:g} s"
        )
    latitude, longitude = trajectory.latitude[i], trajectory.longitude[i]
    check_coverage(field_map, latitude, longitude, partly=truth.route.track is not None)
    value = field_map.value(latitude, longitude)
    attitude, turn = matrix(trajectory.attitude[i]), turn_rates(trajectory)[i]
    at = trajectory.at(i)._replace(attitude=attitude, turn=turn)
    return _measured(truth, field_map).reduction(truth).raw(value, at)


def check_readings(
    truth: Truth, matched: Map, trajectory: Trajectory, field_map: RouteMap
) -> None:
    """Raise InputError where readings of a field cannot be simulated (`true_map`)."""
    if not truth.readings.recorded:
        true_readings(truth, trajectory, true_map(truth, matched, trajectory, field_map))


def check_recorded(assumed: Assumed, trajectory: Trajectory) -> None:
    """Raise InputError where a field's recorded readings cannot be taken from their file; no map
    is needed for it, which may take long to make."""
    for one in assumed.each_field:
        if one.readings.recorded:
            recorded(one, trajectory)


def recorded(settings: Settings, trajectory: Trajectory) -> Recorded:
    """Return the recorded readings of a field's scans, of which `settings` says that there are;
    raises InputError where they cannot be used."""
    steps = settings.steps_per_scan
    count, interval = len(trajectory) // steps, steps * trajectory.dt
    quantity = measured_field(settings).quantity
    clock = trajectory.begin, interval, count
    return recorded_scans(settings.readings, settings.route.track_line, quantity, clock)


def scan_index(settings: Settings, trajectory: Trajectory) -> Integers:
    """Return (scans,) index into the trajectory of each scan; of recorded readings that which is
    nearest to their own times."""
    if settings.readings.recorded:
        own = np.rint(recorded(settings, trajectory).time / trajectory.dt).astype(np.int64)
        return np.clip(own, 0, len(trajectory))
    return np.arange(settings.steps_per_scan, len(trajectory) + 1, settings.steps_per_scan)


def _measured(truth: Truth, field_map: RouteMap) -> MeasuredField:
    """Return the field that a map is of, among those that the instrument measures."""
    instrument = measured_field(truth).instrument
    fields = of_instrument(instrument)
    for field in fields:
        if field.quantity == field_map.quantity:
            return field
    article = "an" if instrument[0] in "aeiou" else "a"
    raise InputError(
        f"map {field_map.provenance}: {article} {instrument} does not measure"
        f" {field_map.quantity}; give {' or '.join(field.quantity for field in fields)}"
    )


def _late(map_error: TrueMapError, field_map: RouteMap, sensed: Array) -> Array:
    """Return (R, scans) what an instrument with a filter or a delay reports, from what a perfect
    one measures at the scans."""
    truth, trajectory, scans = map_error.truth, map_error.trajectory, map_error.index
    every = np.arange(len(trajectory) + 1)
    perfect = true_readings(truth, trajectory, field_map, every)
    error = sensed - perfect[scans]  # of the map
    if truth.map_error.sigma > 0.0:
        error = map_error.between(error)
    else:
        error = np.zeros((len(sensed), len(every)))
    lag = Lag.of(truth.gravimeter)
    return lag.report(trajectory.time, perfect + error, trajectory.time[scans])
