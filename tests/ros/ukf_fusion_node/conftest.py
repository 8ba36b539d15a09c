"""Where the filter begins."""

import pytest

from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory


@pytest.fixture
def start(scenario) -> tuple[float, float]:
    """Latitude and longitude, rad."""
    it = scenario()
    state = draw_initial_state(it.initial_error, build_trajectory(it), it.seed, [0])
    return float(state.position[0, 0]), float(state.position[0, 1])
