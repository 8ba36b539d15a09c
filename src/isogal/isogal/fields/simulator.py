"""Simulated readings of a scalar field: the map as truth, its error, and the sensor's noise,
outliers, bias and drift."""

from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.fields.measured import MeasuredField, measured_field, of_instrument
from isogal.maps.channels import RouteMap
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory


class ReadingSimulator:
    """Readings of R runs at every scan of a route; scan j is taken at the end of IMU interval (j +
    1) * steps_per_scan."""

    def __init__(
        self, scenario: Scenario, trajectory: Trajectory, field_map: RouteMap, runs: Sequence[int]
    ) -> None:
        """Draw all readings; raises InputError as `true_readings` does."""
        self.index = i = _scans(scenario, trajectory)
        """(scans,) index into the trajectory of each scan."""
        truth = true_readings(scenario, trajectory, field_map)
        field = _measured(scenario, field_map)
        errors = field.sign * draw_map_error(scenario, trajectory, i, runs, truth.shape[1:])
        channels, time = field.channels, trajectory.time[i]
        noise = [
            _noise(scenario, run, time)
            if channels is None
            else channels.noise(scenario, run, len(i))
            for run in runs
        ]
        self.felt = field.reduction(scenario).report(truth + errors + np.stack(noise))
        """(R, scans) raw readings, NaN = none; (R, scans, C) of a field with C channels."""


def true_readings(scenario: Scenario, trajectory: Trajectory, field_map: RouteMap) -> Array:
    """Return what a perfect instrument measures at each scan, (scans,) or (scans, C), with the map
    as the truth.

    Raises
    ------
    InputError
        The map does not cover the route, the instrument does not measure its quantity, or no such
        instrument can be there.
    """
    i = _scans(scenario, trajectory)
    latitude, longitude = trajectory.latitude[i], trajectory.longitude[i]
    value = field_map.value(latitude, longitude)
    missing = ~np.isfinite(value.reshape(len(i), -1)).all(axis=1)
    if missing.any():
        j = int(np.argmax(missing))
        raise InputError(
            f"map {field_map.provenance}: does not cover the route at latitude"
            f" {np.degrees(latitude[j]):.4f}, longitude {np.degrees(longitude[j]):.4f} deg"
            f" ({trajectory.time[i[j]]:.0f} s after the start)"
        )
    velocity = trajectory.velocity[i]
    at = State(latitude, longitude, trajectory.height[i], velocity[:, 0], velocity[:, 1])
    return _measured(scenario, field_map).reduction(scenario).raw(value, at)


def _scans(scenario: Scenario, trajectory: Trajectory) -> Integers:
    return np.arange(scenario.steps_per_scan, len(trajectory) + 1, scenario.steps_per_scan)


def _measured(scenario: Scenario, field_map: RouteMap) -> MeasuredField:
    """Return the field that a map is of, among those that the scenario's instrument measures."""
    instrument = measured_field(scenario).instrument
    fields = of_instrument(instrument)
    for field in fields:
        if field.quantity == field_map.quantity:
            return field
    article = "an" if instrument[0] in "aeiou" else "a"
    raise InputError(
        f"map {field_map.provenance}: {article} {instrument} does not feel {field_map.quantity};"
        f" give {' or '.join(field.quantity for field in fields)}"
    )


def _noise(scenario: Scenario, run: int, time: Array) -> Array:
    settings, scans = scenario.gravimeter, len(time)
    noise = settings.sigma * generator(scenario.seed, run, "gravimeter_noise").standard_normal(
        scans
    )
    if settings.outlier_fraction > 0.0:
        random = generator(scenario.seed, run, "gravimeter_outliers")
        hit = random.random(scans) < settings.outlier_fraction
        noise = noise + hit * settings.sigma * settings.outlier_sigma * random.standard_normal(
            scans
        )
    offset, rate = generator(scenario.seed, run, "gravimeter_bias").standard_normal(2)
    return noise + settings.bias * offset + settings.drift * rate * time


def draw_map_error(
    scenario: Scenario,
    trajectory: Trajectory,
    index: Integers,
    runs: Sequence[int],
    channels: tuple[int, ...] = (),
) -> Array:
    """Return (R, scans, *channels) how far the true field differs from the map at the scans, in
    its unit.

    Exact samples of the Gaussian field with covariance sigma² exp(-d / L) at the true positions,
    one field per run and channel."""
    sigma, length = scenario.map_error.sigma, scenario.map_error.correlation_length
    size = (len(index), *channels)
    if sigma == 0.0:
        return np.zeros((len(runs), *size))
    from isogal.earth.frames import geodetic_to_ecef

    points = geodetic_to_ecef(trajectory.latitude[index], trajectory.longitude[index], 0.0)
    distance = np.sqrt(np.maximum(((points[:, None, :] - points[None, :, :]) ** 2).sum(-1), 0.0))
    root = np.linalg.cholesky(sigma**2 * (np.exp(-distance / length) + 1e-12 * np.eye(len(index))))
    # a loop, not one matrix product: a run's numbers must not depend on how many runs are computed
    return np.stack(
        [root @ generator(scenario.seed, run, "map_error").standard_normal(size) for run in runs]
    )
