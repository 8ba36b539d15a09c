"""The gravimeter: what it feels on a moving vehicle, and the reductions that use the navigator's own estimate.

It feels gravity at the vehicle, less the Eötvös acceleration, plus noise. Reduced gravity refers to the map's surface: Eötvös and
free-air terms are put back with estimated velocity, latitude and height. The disturbance is that less normal gravity at the estimated
latitude.
The map's surface is taken at ellipsoidal height 0 and the vehicle at `route.height` above it (SCIENCE 1).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isogal.earth.ellipsoid import EARTH_RATE, radii
from isogal.earth.gravity import FREE_AIR, eotvos, eotvos_jacobian, normal_gravity, normal_gravity_gradient_north
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory

Array = NDArray[np.float64]


def felt_gravity(
    surface_gravity: ArrayLike, latitude: ArrayLike, height: ArrayLike, v_north: ArrayLike, v_east: ArrayLike
) -> Array:
    """Return what a perfect gravimeter feels (m/s²) over a point whose gravity on the map's surface is given."""
    return np.asarray(surface_gravity) - FREE_AIR * np.asarray(height) - eotvos(latitude, height, v_north, v_east)


def reduce_gravity(
    felt: ArrayLike, latitude: ArrayLike, height: ArrayLike, v_north: ArrayLike, v_east: ArrayLike
) -> Array:
    """Return gravity on the map's surface (m/s²) from a reading and the navigator's latitude (rad), height (m) and velocity (m/s)."""
    return np.asarray(felt) + FREE_AIR * np.asarray(height) + eotvos(latitude, height, v_north, v_east)


def reduce_disturbance(
    felt: ArrayLike, latitude: ArrayLike, height: ArrayLike, v_north: ArrayLike, v_east: ArrayLike
) -> Array:
    """Return the gravity disturbance (m/s²): reduced gravity less normal gravity at the navigator's latitude."""
    return reduce_gravity(felt, latitude, height, v_north, v_east) - normal_gravity(latitude)


def reading_jacobian(quantity: str, latitude: ArrayLike, v_north: ArrayLike, v_east: ArrayLike) -> Array:
    """Return d(reading)/d(navigator's error) (..., 4) for errors (north m, east m, v_north m/s, v_east m/s) at the scan.

    Reductions with a wrong velocity or latitude put the wrong Eötvös term back; a disturbance also has normal gravity of the wrong
    latitude taken off. Zero for any quantity that is not reduced with the navigator's estimate.
    """
    lat = np.asarray(latitude, dtype=float)
    jacobian = np.zeros((*lat.shape, 4))
    if quantity in ("gravity", "disturbance"):
        jacobian[..., 2], jacobian[..., 3] = eotvos_jacobian(lat, v_north, v_east)
        jacobian[..., 0] = -2.0 * EARTH_RATE * np.sin(lat) * np.asarray(v_east) / radii(lat)[0]
    if quantity == "disturbance":
        jacobian[..., 0] -= normal_gravity_gradient_north(lat)
    return jacobian


def reduction_variance(
    quantity: str,
    latitude: ArrayLike,
    v_north: ArrayLike,
    v_east: ArrayLike,
    covariance: Array,
    height_variance: ArrayLike,
) -> Array:
    """Return the variance (m²/s⁴) that the navigator's uncertainty puts into a reduced reading.

    Parameters
    ----------
    covariance : (..., 4, 4) array
        Of (north, east, v_north, v_east) errors; height_variance (...) m².
    """
    jacobian = reading_jacobian(quantity, latitude, v_north, v_east)
    return np.einsum("...i,...ij,...j->...", jacobian, covariance, jacobian) + FREE_AIR**2 * np.asarray(height_variance)


class GravimeterSimulator:
    """Readings of R runs at every scan of a route; scan j is taken at the end of IMU interval (j + 1) * steps_per_scan."""

    def __init__(self, scenario: Scenario, trajectory: Trajectory, field_map: FieldMap, runs: Sequence[int]) -> None:
        """Draw all readings.

        Raises
        ------
        InputError
            The map does not cover the route, or its quantity cannot be felt by a gravimeter.
        """
        stride = scenario.steps_per_scan
        self.index = np.arange(stride, len(trajectory) + 1, stride)
        """(scans,) index into the trajectory of each scan."""
        i = self.index
        latitude, longitude = trajectory.latitude[i], trajectory.longitude[i]
        surface = field_map.value(latitude, longitude)
        missing = ~np.isfinite(surface)
        if missing.any():
            j = int(np.argmax(missing))
            raise InputError(
                f"map {field_map.provenance}: does not cover the route at latitude {np.degrees(latitude[j]):.4f},"
                f" longitude {np.degrees(longitude[j]):.4f} deg ({trajectory.time[i[j]]:.0f} s after the start)"
            )
        if field_map.quantity == "disturbance":
            surface = surface + normal_gravity(latitude)
        elif field_map.quantity != "gravity":
            raise InputError(
                f"map {field_map.provenance}: a gravimeter does not feel {field_map.quantity}; give gravity or disturbance"
            )
        velocity = trajectory.velocity[i]
        truth = felt_gravity(surface, latitude, trajectory.height[i], velocity[:, 0], velocity[:, 1])
        errors = draw_map_error(scenario, trajectory, i, runs)
        self.felt = np.stack([truth + errors[k] + _noise(scenario, run, len(i)) for k, run in enumerate(runs)])
        """(R, scans) m/s²."""


def _noise(scenario: Scenario, run: int, scans: int) -> Array:
    settings = scenario.gravimeter
    noise = settings.sigma * generator(scenario.seed, run, "gravimeter_noise").standard_normal(scans)
    if settings.outlier_fraction > 0.0:
        random = generator(scenario.seed, run, "gravimeter_outliers")
        hit = random.random(scans) < settings.outlier_fraction
        noise = noise + hit * settings.sigma * settings.outlier_sigma * random.standard_normal(scans)
    return noise


def draw_map_error(scenario: Scenario, trajectory: Trajectory, index: NDArray[np.int64], runs: Sequence[int]) -> Array:
    """Return (R, scans) how far the true field differs from the map at the scans, m/s².

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
