"""What a navigator knows of horizontal gravity: a map to take off at its own position, and how
much it believes to be left (docs/mathematics.md, section 3.9)."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array
from isogal.fields.gravity_vector import gravity_vector
from isogal.fields.measured import measured_field
from isogal.inertial.gravity import Compensation, compensation_by, no_compensation
from isogal.maps.tiled_map import ScalarMap
from isogal.scenario import Assumed, Gravity, Settings, Truth
from isogal.sensors.trajectory import Trajectory

UNSPECIFIED_MAP_SIGMA = 2e-5
"""m/s², of a map's disturbance where none is given, nor will be learnt: between good surveys and
terrain models."""
WORST_MAP_SIGMA = 8e-5
"""m/s², that few maps exceed, as global models do among mountains; where it will be learnt, until
the first batch has shown it. With less, what satellites say of tilts and biases in these minutes
is believed too much, for good."""
RESOLUTION_SIGMA = 1e-6
"""m/s², 1-sigma of what is left of horizontal gravity for the cells of a map."""


@dataclass(frozen=True, slots=True)
class Residual:
    """How much of horizontal gravity no compensation takes off, for a map as wrong as it may be
    (docs/mathematics.md, section 3.9)."""

    uncompensated: float
    """(m/s²)², variance of what is not taken off of the map's own, of each component."""
    uncompensated_length: float
    """m, its correlation length along the route."""
    sigma: float | None = None
    """m/s², of each component in all, where it is specified."""
    length: float | None = None
    """m, correlation length, where it is specified."""

    def given(self, map_sigma: float, map_length: float) -> tuple[float, float]:
        """Return 1-sigma of each component (m/s²) and correlation length (m) where the map's
        disturbance is wrong by a 1-sigma (m/s²) over a correlation length (m)."""
        wrong = 0.5 * map_sigma**2 + RESOLUTION_SIGMA**2
        total = self.uncompensated + wrong
        share = self.uncompensated / total
        length = self.uncompensated_length**share * map_length ** (1.0 - share)
        return (
            math.sqrt(total) if self.sigma is None else self.sigma,
            length if self.length is None else self.length,
        )


@dataclass(frozen=True)
class KnownGravity:
    """A map to take off, and what is believed to be left."""

    compensation: Compensation = field(default_factory=no_compensation)
    residual: Residual | None = None
    """None = nothing is left."""
    map_sigma: float = 0.0
    """m/s², assumed 1-sigma of the map's disturbance."""
    map_length: float = 4000.0
    """m, its assumed correlation length."""

    @property
    def residual_sigma(self) -> float:
        """1-sigma of what is left, m/s², of each component; 0 = nothing."""
        return self._left(self.map_sigma)[0]

    @property
    def residual_length(self) -> float:
        """Its correlation length along the track, m."""
        return self._left(self.map_sigma)[1]

    @property
    def most_left(self) -> float:
        """1-sigma of what a bad map leaves, m/s², of each component; as specified where it is."""
        return self._left(max(self.map_sigma, WORST_MAP_SIGMA))[0]

    def _left(self, map_sigma: float) -> tuple[float, float]:
        given = self.residual and self.residual.given(map_sigma, self.map_length)
        return given or (0.0, self.map_length)


def known_gravity(assumed: Assumed, trajectory: Trajectory) -> KnownGravity:
    """Return what the navigator of a scenario knows of horizontal gravity: of its own assumptions,
    not of what is true.

    Raises
    ------
    InputError
        The map cannot be read, or does not cover the route.
    """
    vector = gravity_vector(assumed, trajectory)
    if vector is None:
        return KnownGravity()
    left = residual_gravity(assumed, trajectory)
    return replace(left, compensation=compensation_by(vector.horizontal, _share(assumed.gravity)))


def residual_gravity(
    settings: Settings, trajectory: Trajectory, map_sigma: float | None = None
) -> KnownGravity:
    """Return what `known_gravity` does without the compensation: only what is believed to be left.

    Where all of the map's horizontal gravity is taken off, the map's own part is not computed.
    `map_sigma` (m/s²) is the assumed 1-sigma of the map's disturbance, half of whose
    variance each horizontal component has; None = as the navigator assumes."""
    vector, gravity = gravity_vector(settings, trajectory), settings.gravity
    if vector is None:
        return KnownGravity()
    if map_sigma is None:
        map_sigma = _assumed_map_sigma(settings, vector.disturbance)
    left, length = 0.0, 1.0
    if (share := _share(gravity)) < 1.0:
        along = vector.horizontal.value(trajectory.latitude, trajectory.longitude)
        left = (1.0 - share) ** 2 * float(np.nanmean(along**2))
        length = _correlation_length(trajectory, along)
    fixed = gravity.residual_sigma, gravity.residual_correlation_length
    residual = Residual(left, length, *(None if one == "auto" else float(one) for one in fixed))
    of_error = settings.matcher.map_correlation_length
    return KnownGravity(residual=residual, map_sigma=map_sigma, map_length=of_error)


def true_residual_gravity(truth: Truth, trajectory: Trajectory) -> KnownGravity:
    """Return what is really left of horizontal gravity after its compensation, without that."""
    error = truth.map_error
    left = residual_gravity(truth, trajectory, error.sigma)
    if left.residual is None:
        return left
    residual = replace(left.residual, sigma=None, length=None)
    return replace(left, residual=residual, map_length=error.correlation_length)


def _share(settings: Gravity) -> float:
    """Return the share of the map's horizontal gravity that the navigator takes off."""
    return settings.compensated_share if settings.compensation == "map" else 0.0


def _assumed_map_sigma(settings: Settings, disturbance: ScalarMap) -> float:
    """Return the 1-sigma that a navigator assumes of a map of the disturbance, m/s²: as the map
    says, or that of the matcher if it matches gravity, where that is more."""
    assumed, stated = settings.matcher.map_sigma, float(np.nanmean(disturbance.sigma))
    of_gravity = measured_field(settings).instrument == "gravimeter"
    if of_gravity and settings.matcher.learns_map_error:
        return max(stated, WORST_MAP_SIGMA)
    if assumed == "auto" or not of_gravity:
        return max(stated, UNSPECIFIED_MAP_SIGMA)
    return max(stated, float(assumed))


def _correlation_length(trajectory: Trajectory, along: Array) -> float:
    """Return the distance (m) along a route at which the horizontal components' autocorrelation
    falls to 1/e."""
    speed = float(np.hypot(*trajectory.velocity[:, :2].T).mean())
    step = max(1, round(500.0 / max(speed * trajectory.dt, 1e-3)))
    values = along[::step] - along.mean(axis=0)
    count = len(values)
    power = np.abs(np.fft.rfft(values, 2 * count, axis=0)) ** 2
    correlation = np.fft.irfft(power.sum(axis=1))[:count] / (count - np.arange(count))
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    lag = float(below[0]) if below.size else float(count)
    return max(lag, 1.0) * step * speed * trajectory.dt
