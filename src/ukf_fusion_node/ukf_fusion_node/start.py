"""Where the filter starts."""

import math
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.inertial.rotations import multiply
from isogal.inertial.strapdown import NavState
from isogal.scenario import Scenario
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory


def initial_state(scenario: Scenario, settings: Any) -> NavState:
    """Return the first state: what the parameters give, the rest as the scenario draws it.

    Raises
    ------
    InputError
        A start is given in part, or is no place.
    """
    parts = {
        name: np.array(getattr(settings, name), dtype=float)
        for name in ("start_position", "start_velocity", "start_attitude")
    }
    for name, value in parts.items():
        if np.isnan(value).any() and not np.isnan(value).all():
            raise InputError(f"{name}: give all three numbers, or none")
    given = {name: value for name, value in parts.items() if not np.isnan(value).any()}
    # two samples of the route are enough to know its start
    route = scenario.route.model_copy(update={"duration": 2.0 / scenario.imu.rate})
    short = scenario.model_copy(update={"route": route})
    state = draw_initial_state(scenario, build_trajectory(short), [settings.run])
    position, velocity, attitude = (
        state.position.copy(),
        state.velocity.copy(),
        state.attitude.copy(),
    )
    if "start_position" in given:
        latitude, longitude, height = given["start_position"]
        if not (abs(latitude) <= 89.0 and abs(longitude) <= 360.0 and math.isfinite(height)):
            raise InputError(
                f"start_position: no such place: {latitude}, {longitude} deg, {height} m"
            )
        position[0] = math.radians(latitude), math.radians(longitude), height
    if "start_velocity" in given:
        velocity[0] = given["start_velocity"]
    if "start_attitude" in given:
        attitude[0] = _from_angles(*np.radians(given["start_attitude"]))
    return NavState(position, velocity, attitude)


def _from_angles(roll: float, pitch: float, heading: float) -> tuple[float, ...]:
    """Return the quaternion FRD to NED of heading, pitch, roll in this order (Groves 2013, eq.
    2.38)."""
    about = [(math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (roll, pitch, heading)]
    (cr, sr), (cp, sp), (ch, sh) = about
    pitched = multiply(ch, 0.0, 0.0, sh, cp, 0.0, sp, 0.0)
    return tuple(multiply(*pitched, cr, sr, 0.0, 0.0))
