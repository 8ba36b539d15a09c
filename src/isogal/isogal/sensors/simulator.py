"""Simulated readings of a scalar field: the map as truth, its error, and the sensor's noise and outliers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal.sensors.fields import ScalarField, of_instrument, scalar_field
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory

Array = NDArray[np.float64]


class ReadingSimulator:
    """Readings of R runs at every scan of a route; scan j is taken at the end of IMU interval (j + 1) * steps_per_scan."""

    def __init__(self, scenario: Scenario, trajectory: Trajectory, field_map: FieldMap, runs: Sequence[int]) -> None:
        """Draw all readings.

        Raises
        ------
        InputError
            The map does not cover the route, its quantity cannot be felt by the instrument, or no such instrument can be there.
        """
        stride = scenario.steps_per_scan
        self.index = np.arange(stride, len(trajectory) + 1, stride)
        """(scans,) index into the trajectory of each scan."""
        i = self.index
        latitude, longitude = trajectory.latitude[i], trajectory.longitude[i]
        value = field_map.value(latitude, longitude)
        missing = ~np.isfinite(value)
        if missing.any():
            j = int(np.argmax(missing))
            raise InputError(
                f"map {field_map.provenance}: does not cover the route at latitude {np.degrees(latitude[j]):.4f},"
                f" longitude {np.degrees(longitude[j]):.4f} deg ({trajectory.time[i[j]]:.0f} s after the start)"
            )
        field = _felt(scenario, field_map)
        reduction = field.reduction(scenario)
        velocity = trajectory.velocity[i]
        truth = reduction.raw(value, State(latitude, longitude, trajectory.height[i], velocity[:, 0], velocity[:, 1]))
        errors = field.sign * draw_map_error(scenario, trajectory, i, runs)
        felt = [truth + errors[k] + _noise(scenario, run, len(i)) for k, run in enumerate(runs)]
        self.felt = reduction.report(np.stack(felt))
        """(R, scans) raw readings, NaN = none."""


def _felt(scenario: Scenario, field_map: FieldMap) -> ScalarField:
    """Return the field that a map is of, among those that the scenario's instrument feels."""
    instrument = scalar_field(scenario).instrument
    fields = of_instrument(instrument)
    for field in fields:
        if field.quantity == field_map.quantity:
            return field
    article = "an" if instrument[0] in "aeiou" else "a"
    raise InputError(
        f"map {field_map.provenance}: {article} {instrument} does not feel {field_map.quantity};"
        f" give {' or '.join(field.quantity for field in fields)}"
    )


def _noise(scenario: Scenario, run: int, scans: int) -> Array:
    settings = scenario.gravimeter
    noise = settings.sigma * generator(scenario.seed, run, "gravimeter_noise").standard_normal(scans)
    if settings.outlier_fraction > 0.0:
        random = generator(scenario.seed, run, "gravimeter_outliers")
        hit = random.random(scans) < settings.outlier_fraction
        noise = noise + hit * settings.sigma * settings.outlier_sigma * random.standard_normal(scans)
    return noise


def draw_map_error(scenario: Scenario, trajectory: Trajectory, index: NDArray[np.int64], runs: Sequence[int]) -> Array:
    """Return (R, scans) how far the true field differs from the map at the scans, in its unit.

    Exact samples of the Gaussian field with covariance sigma² exp(-d / L) at the true positions, one field per run.
    """
    sigma, length = scenario.map_error.sigma, scenario.map_error.correlation_length
    if sigma == 0.0:
        return np.zeros((len(runs), len(index)))
    from isogal.earth.frames import geodetic_to_ecef

    points = geodetic_to_ecef(trajectory.latitude[index], trajectory.longitude[index], 0.0)
    distance = np.sqrt(np.maximum(((points[:, None, :] - points[None, :, :]) ** 2).sum(-1), 0.0))
    root = np.linalg.cholesky(sigma**2 * (np.exp(-distance / length) + 1e-12 * np.eye(len(index))))
    # a loop, not one matrix product: a run's numbers must not depend on how many runs are computed
    return np.stack([root @ generator(scenario.seed, run, "map_error").standard_normal(len(index)) for run in runs])
