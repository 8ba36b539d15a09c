"""A velocity aid, its errors and the water or air that it moves through as states of the filter
(docs/mathematics.md, section 3.12):

    z = (1 + s) (I - [m x]) C' (v - c) + noise

with the velocity v and the current or wind c (NED, m/s), the attitude C (body to NED), mounting
errors m about the right and the down axis (rad) and a scale factor error s."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.model import (
    Innovation,
    LinearMeasurement,
    Rows,
    stated,
    update_linear,
)
from isogal.fusion.measurements.rest import AtRest
from isogal.fusion.measurements.trust import (
    STANDSTILL,
    VELOCITY,
    squared,
    standstill_waits,
    untrusted,
    update_insistent,
    update_once_it_agrees,
)
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import cross_matrix, matrix
from isogal.scenario import Velocity


def _names(prefix: str, medium: str) -> tuple[str, ...]:
    """Return what the states of `velocity_error_states` are called."""
    of_sensor = (f"{prefix}_{one}" for one in ("scale", "pitch", "yaw"))
    return (*of_sensor, f"{medium}_north", f"{medium}_east")


def velocity_error_states(aids: Sequence[Velocity]) -> tuple[AuxiliaryState, ...]:
    """Return of each aid the scale factor error, mounting errors about the right and the down
    axis, and the current or wind to the north and east. What several move through is one, as the
    first of them has it that has any."""
    found = {one.name: one for aid in reversed(aids) for one in _states(aid) if one.sigma > 0.0}
    return tuple(found.values())


def _states(velocity: Velocity) -> Iterator[AuxiliaryState]:
    names = _names(velocity.prefix, velocity.medium)
    errors = "scale", "misalignment", "misalignment"
    for axis, (name, key) in enumerate(zip(names, errors, strict=False)):
        yield AuxiliaryState(name, "none", axis, velocity.number(key))
    current = velocity.number("current_sigma")
    time, length = velocity.current_time, velocity.current_length
    for axis, name in enumerate(names[3:]):
        yield AuxiliaryState(name, "none", axis, current, time, length)


_ANY = Velocity()


@dataclass(frozen=True, slots=True, eq=False)
class VelocityReading(LinearMeasurement):
    """A reading of the velocity in body axes.

    One that is slower than the aid's `standstill_speed` means that the vehicle stands still on the
    ground. Where fixes have contradicted the navigator (`Widening`) others have to agree with it
    for a while: its own velocity has no error that fixes do not correct in time, an aid that is
    not what it says pulls it away from the truth again and again."""

    velocity: Array
    """(3,) forward, right, down, m/s; NaN = not measured, but one of them is."""
    covariance: Array
    """(3, 3) of its white noise, (m/s)²."""
    aid: Velocity = _ANY
    """Which it is of."""
    rate: Array | None = None
    """(3,) what the gyroscopes read then, rad/s; None = not known."""
    prefix: str = "velocity"
    medium: str = "current"
    """Of the names of its states: the aid's, which take it as long to say as all the rest."""

    @classmethod
    def of(
        cls,
        settings: Velocity,
        velocity: Array,
        covariance: Array | None = None,
        rate: Array | None = None,
    ) -> "VelocityReading | None":
        """Return a reading (3,) of a scenario's aid; None where it has no number.

        Parameters
        ----------
        settings : scenario.Velocity
        velocity : (3,) array
            Forward, right, down, m/s; NaN = not measured.
        covariance : (3, 3) array, optional
            Of its white noise; None, or zero variances = as the settings have it.
        rate : (3,) array, optional
            What the gyroscopes read then, rad/s, by which the sensor's lever arm has a velocity of
            its own, and which is zero rotation where the vehicle stands still; None = not known.
            The Earth's rotation and what scale and mounting make of the arm's velocity, below a
            tenth of a mm/s and a hundredth of some cm/s, are left out.
        """
        if rate is not None and any(settings.lever_arm):
            velocity = velocity - np.cross(rate, settings.lever_arm)
        if not np.isfinite(velocity).any():
            return None
        if settings.kind == "wheels" and np.isnan(velocity[1]):
            velocity = np.array([velocity[0], 0.0, velocity[2]])
        R = stated(np.eye(3) * settings.number("sigma") ** 2, covariance)
        return cls(velocity, R, settings, rate, settings.prefix, settings.medium)

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        if np.linalg.norm(self.velocity[np.isfinite(self.velocity)]) < self.aid.standstill_speed:
            return self._update_at_standstill(state, model)
        rows = self.rows(state, model)
        if VELOCITY in state.contradicted:
            return update_once_it_agrees(state, model, rows)
        result = update_insistent(state, model, rows, self.prefix)
        if result.used:
            state.contradicted.pop(STANDSTILL, None)
        return result

    def _update_at_standstill(self, state: FilterState, model: FilterModel) -> Innovation:
        """Update with what the vehicle's standing still says. Wheels also stand where it is
        carried: zeros are used once the gyroscopes have agreed with so many as
        `standstill_waits` says."""
        rows = self._standing(state, model)
        sigma = self.aid.standstill_rate
        if sigma is not None and self.rate is not None:
            gyroscopes = AtRest(np.full(3, np.nan), self.rate, 1.0, sigma).rows(state, model)
            if standstill_waits(state, gyroscopes, squared(state, rows) > model.gate(3)):
                return untrusted(state, model, rows, STANDSTILL, "the vehicle may be carried")
            update_linear(state, model, gyroscopes)
            rows = self._standing(state, model)  # of the state that these have changed
        return update_insistent(state, model, rows, STANDSTILL)

    def _standing(self, state: FilterState, model: FilterModel) -> Rows:
        """Return the rows of a vehicle that stands, in body axes: a zero in others would measure
        the heading (`moved`)."""
        to_body, H = matrix(state.attitude).T, np.zeros((3, model.states))
        H[:, 3:6], H[:, 6:9] = to_body, to_body @ cross_matrix(state.velocity)
        expected = to_body @ state.velocity
        return Rows(np.zeros(3), expected, H, np.eye(3) * self.aid.standstill_sigma**2)

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state, as of a vehicle that moves."""
        axes = np.flatnonzero(np.isfinite(self.velocity))
        places = [model.places.get(name) for name in _names(self.prefix, self.medium)]
        errors = state.auxiliary.tolist()
        scale, about_right, about_down, *flow = (
            0.0 if at is None else errors[at - FILTER_STATES] for at in places
        )
        past = state.velocity - [*flow, 0.0]  # relative to the ground, the water or the air
        rotation, factor = matrix(state.attitude), 1.0 + scale
        x, y, z = (rotation.T @ past).tolist()  # np.cross would take as long as all the rest
        across = y * about_down - z * about_right, -x * about_down, x * about_right
        turned = np.array([x, y, z]) + across
        by_body = factor * (np.eye(3) - cross_matrix([0.0, about_right, about_down]))
        by_past = by_body @ rotation.T
        H = np.zeros((3, model.states))
        H[:, 3:6], H[:, 6:9] = by_past, by_past @ cross_matrix(past)
        of_mounting = [-factor * z, 0.0, factor * x], [factor * y, -factor * x, 0.0]
        columns = turned, *of_mounting, -by_past[:, 0], -by_past[:, 1]
        for at, column in zip(places, columns, strict=True):
            if at is not None:
                H[:, at] = column
        R = self.covariance[np.ix_(axes, axes)]
        measured = np.asarray(self.velocity, dtype=float)[axes]
        return Rows(measured, factor * turned[axes], H[axes], R)
