"""First attitudes of a navigator that knows none (docs/mathematics.md, section 3.20).

Two directions that are known in both frames give an attitude (TRIAD: Black 1964): gravity and the
Earth's axis at rest. With gravity alone, or what the accelerometers feel of it and of a known
acceleration, the turn about it is open: a bank of headings, evenly spaced, covers it.

A start is given again and again with a better attitude (`Start.state`): what a filter has learnt
about a large heading error was linearised in the wrong place."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fusion.measurements import AtRest
from isogal.fusion.measurements.rest import sensed_at_rest
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import (
    cross_matrix,
    from_matrix,
    from_rotation_vector,
    matrix,
    multiply,
)

HEADINGS = 24
"""Of a bank. Each has a 1-sigma of half the distance to the next, 7.5 deg, where sin x differs
from x by less than 0.3 %."""
UNKNOWN_TILT = 0.5
"""rad, 1-sigma of a tilt that the readings themselves will tell."""


def north_sigma(model: FilterModel, latitude: float) -> float:
    """Return the 1-sigma (rad) to which the gyroscopes of a vehicle at rest can find north: their
    bias to the east divided by the Earth's horizontal rate (Titterton & Weston 2004, section
    10.3).

    Parameters
    ----------
    model : FilterModel
    latitude : float
        rad.
    """
    sigmas = {one.name: one.sigma for one in model.auxiliary}
    in_run = [sigmas.get(f"gyroscope_in_run_{axis}", 0.0) for axis in "xy"]
    bias = np.hypot(model.initial_sigma[12:14], in_run)
    return float(np.sqrt(np.mean(bias**2)) / (EARTH_RATE * max(math.cos(latitude), 1e-6)))


def between_directions(body: Array, navigation: Array) -> Array:
    """Return the quaternion (4,) of the smallest rotation that turns a direction (3,) of the body
    to one of the navigation frame (3,)."""
    a, b = (one / np.linalg.norm(one) for one in (body, navigation))
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -0.999999:  # upside down: about any axis that is square to it
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        return np.array([0.0, *(axis / np.linalg.norm(axis))])
    q = np.array([1.0 + cosine, *axis])
    return np.asarray(q / np.linalg.norm(q))


def triad(force: tuple[Array, Array], rate: tuple[Array, Array]) -> Array:
    """Return the quaternion (4,) of two directions, each in the body and in the navigation frame;
    the first is exact. Where the second is parallel to it, or nothing, so that it does not tell
    the turn about it, any turn will do."""
    axes = []
    for one, other in zip(force, rate, strict=True):
        first = one / np.linalg.norm(one)
        second = np.cross(first, other)
        if not second.any():  # gyroscopes that read nothing, or the vertical alone
            second = np.cross(first, np.eye(3)[int(np.argmin(np.abs(first)))])
        second /= np.linalg.norm(second)
        axes.append(np.stack([first, second, np.cross(first, second)], axis=1))
    in_body, in_navigation = axes
    return np.asarray(from_matrix(in_navigation @ in_body.T))


@dataclass(frozen=True, slots=True)
class Place:
    """Where a navigator begins."""

    position: Array
    """(3,) latitude rad, longitude rad, height m."""
    covariance: Array
    """(2, 2) m², north-east."""


@dataclass(frozen=True, eq=False)
class Start:
    """What is known at the beginning but for the heading."""

    model: FilterModel
    time: float
    """s."""
    place: Place
    velocity: Array
    """(3,) m/s, NED, or of the body."""
    velocity_covariance: Array
    """(3, 3) (m/s)²."""
    of_body: bool
    """Whether the velocity is in body axes."""
    force: tuple[Array, Array]
    """What the accelerometers felt, m/s²: body, NED."""
    tilt: float
    """rad, 1-sigma of its direction."""
    rest: AtRest | None = None
    """Of a vehicle at rest, the means that the start is made of."""

    @cached_property
    def level(self) -> Array:
        """(4,) quaternion that levels, with any heading."""
        return between_directions(*self.force)

    @property
    def found(self) -> Array | None:
        """(4,) attitude that the Earth's rate gives; None where the vehicle may not be at rest."""
        if self.rest is None:
            return None
        of_earth = sensed_at_rest(self.place.position, self.model)[1]
        return triad(self.force, (self.rest.rate, of_earth))

    def state(self, attitude: Array, heading: float, tilt: float | None = None) -> FilterState:
        """Return the state of an attitude.

        Parameters
        ----------
        attitude : (4,) array
            Quaternion body to NED.
        heading : float
            Its 1-sigma about the vertical, rad.
        tilt : float, optional
            About the horizontal axes; default: as the start has it.
        """
        return self._rested(self._prior(attitude, heading, tilt or self.tilt))[0]

    def _prior(self, attitude: Array, heading: float, tilt: float) -> FilterState:
        """Return the state of an attitude without the means at rest."""
        turn = matrix(attitude)
        velocity = turn @ self.velocity if self.of_body else self.velocity
        estimate = Estimate(self.place.position, velocity, attitude)
        state = FilterState.start(estimate, self.model)
        P, spread = state.covariance, np.diag(np.square([tilt, tilt, heading]))
        P[:2, :2] = self.place.covariance
        P[6:9, 6:9], P[3:6, 3:6] = spread, self.velocity_covariance
        if self.of_body:
            by = -cross_matrix(velocity)
            P[3:6, 6:9], P[6:9, 3:6] = by @ spread, spread @ by.T
            P[3:6, 3:6] = by @ spread @ by.T + turn @ self.velocity_covariance @ turn.T
        return state

    def _rested(self, state: FilterState) -> tuple[FilterState, float]:
        """Return a state that knows the means at rest, and the log likelihood that it had."""
        if self.rest is None:
            return state, 0.0
        return state, self.rest.update(state, self.model).log_likelihood

    def bank(self) -> Mixture:
        """Return the states of a bank of headings."""
        step = 2.0 * math.pi / HEADINGS
        axis = self.force[1] / np.linalg.norm(self.force[1])
        turns = [from_rotation_vector(*(k * step * axis)) for k in range(HEADINGS)]
        attitudes = [np.array(multiply(*q, *self.level)) for q in turns]
        pairs = [self._rested(self._prior(q, 0.5 * step, self.tilt)) for q in attitudes]
        states, likelihoods = zip(*pairs, strict=True)
        weights = np.array(likelihoods)
        return Mixture(list(states), weights - np.logaddexp.reduce(weights))
