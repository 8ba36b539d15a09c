"""A heading, and its errors as states of the filter (docs/mathematics.md, section 3.16):

    z = atan2(f_east, f_north) - D + b + c + v

with the bow f = C (1, 0, 0), the attitude C (body to NED), for a compass the declination D of the
main field, a constant mounting error b, an error c that changes slowly, and white noise v; rad. A
course over ground has the angle of crab as c."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.model import (
    Innovation,
    LinearMeasurement,
    Rows,
    update_linear,
    white_part,
)
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import matrix
from isogal.scenario import HeadingAid
from isogal.sensors.heading_aid import declination

STEEPEST = 0.1
"""Horizontal part of the bow below which it has no heading: within 6 degrees of the vertical."""


def heading_error_states(aid: HeadingAid) -> tuple[AuxiliaryState, ...]:
    """Return mounting error and slowly changing error."""
    slow, time = aid.number("correlated_sigma"), aid.correlation_time
    return (
        AuxiliaryState(f"{aid.prefix}_mounting", "none", 0, aid.number("bias")),
        AuxiliaryState(f"{aid.prefix}_slow", "none", 0, slow, time=time),
    )


@dataclass(frozen=True, slots=True)
class HeadingReading(LinearMeasurement):
    """A reading of the heading."""

    heading: float
    """rad."""
    variance: float
    """rad², of its white noise."""
    error: str = ""
    """What the names of the auxiliary states of its errors begin with."""
    epoch: float | None = None
    """Decimal year of a reading from magnetic north; None = it is from true north."""
    slowest: float = 0.0
    """m/s; of a slower vehicle it says nothing."""

    @classmethod
    def of(
        cls, aid: HeadingAid, heading: float, epoch: float, variance: float | None = None
    ) -> "HeadingReading":
        """Return a reading (rad) of a scenario's aid.

        Parameters
        ----------
        aid : scenario.HeadingAid
        heading : float
            rad.
        epoch : float
            Decimal year, for a compass.
        variance : float, optional
            Of its whole error but the mounting's, rad², as the aid states it; None = as the
            scenario has it.
        """
        white = aid.number("sigma") ** 2
        if variance is not None:
            slow = np.array([aid.number("correlated_sigma") ** 2])
            white = float(white_part(np.array([[variance]]), slow)[0, 0])
        when = epoch if aid.kind == "compass" else None
        slowest = aid.slowest if aid.kind == "course" else 0.0
        return cls(heading, white, aid.prefix, when, slowest)

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        if math.hypot(*state.velocity[:2]) < self.slowest:
            return Innovation.refused(f"slower than {self.slowest:g} m/s: no course")
        if math.hypot(*matrix(state.attitude)[:2, 0]) < STEEPEST:
            return Innovation.refused("the bow is vertical: no heading")
        return update_linear(state, model, self.rows(state, model))

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        rotation, H = matrix(state.attitude), np.zeros((1, model.states))
        north, east, down = rotation[:, 0]
        # a bow that points up turns with a tilt
        level = north * north + east * east
        H[0, 6:9] = -north * down / level, -east * down / level, 1.0
        expected = math.atan2(east, north)
        for name in (f"{self.error}_mounting", f"{self.error}_slow"):
            if (at := model.places.get(name)) is not None:
                H[0, at] = 1.0
                expected += float(state.auxiliary[at - FILTER_STATES])
        if self.epoch is not None:
            latitude, longitude = state.position[:2].tolist()
            expected -= declination(latitude, longitude, self.epoch)
        measured = expected + math.remainder(self.heading - expected, 2.0 * math.pi)
        return Rows(np.array([measured]), np.array([expected]), H, np.array([[self.variance]]))
