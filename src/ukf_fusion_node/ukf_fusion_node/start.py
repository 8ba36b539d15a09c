"""The filter's first state."""

import math

import numpy as np

from isogal.errors import InputError
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_angles
from isogal.scenario import Scenario
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory
from ukf_fusion_node.settings import UkfFusionSettings


def initial_state(scenario: Scenario, settings: UkfFusionSettings) -> Estimate:
    """Return the first state: what the parameters give, and the rest as the scenario draws it,
    with errors as large as they really are.

    Raises
    ------
    InputError
        Only some of the numbers of a start are given, or the position is impossible.
    """
    # two steps of the route are enough to know its start
    route = scenario.route.model_copy(update={"duration": 2.0 / scenario.navigation_rate})
    short = scenario.model_copy(update={"route": route})
    drawn = draw_initial_state(scenario.true, build_trajectory(short), [settings.run])
    state = Estimate(drawn.position[0], drawn.velocity[0], drawn.attitude[0])
    return with_given(settings, state)


def with_given(settings: UkfFusionSettings, state: Estimate) -> Estimate:
    """Return a start with what the parameters give of it; raises InputError as `initial_state`."""
    parts = {
        name: np.array(getattr(settings, name), dtype=float)
        for name in ("start_position", "start_velocity", "start_attitude")
    }
    for name, value in parts.items():
        if np.isnan(value).any() and not np.isnan(value).all():
            raise InputError(f"{name}: give all three numbers, or none")
    given = {name: value for name, value in parts.items() if not np.isnan(value).any()}
    state = Estimate(*(part.copy() for part in state))
    if "start_position" in given:
        latitude, longitude, height = given["start_position"]
        if not (abs(latitude) <= 89.9 and abs(longitude) <= 360.0 and math.isfinite(height)):
            raise InputError(
                f"start_position: no such place: {latitude}, {longitude} deg, {height} m"
            )
        state.position[:] = math.radians(latitude), math.radians(longitude), height
    if "start_velocity" in given:
        state.velocity[:] = given["start_velocity"]
    if "start_attitude" in given:
        state.attitude[:] = from_angles(*np.radians(given["start_attitude"]))
    return state
