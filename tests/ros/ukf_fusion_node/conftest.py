"""A filter on a bench, and where it begins."""

from collections.abc import Callable, Iterator

import pytest

from helpers.node_bench import Bench, bench
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics


@pytest.fixture
def filtering(scenario) -> Iterator[Bench]:
    """A filter of the plain scenario."""
    with bench(topics.UKF_FUSION, scenario()) as made:
        yield made


@pytest.fixture(scope="session")
def advance() -> Callable[[Bench, int, int], None]:
    """Sends samples of a first to a last second."""

    def send(made: Bench, first: int, last: int) -> None:
        for second in range(first, last + 1):
            made.imu(second)

    return send


@pytest.fixture
def start(scenario) -> tuple[float, float]:
    """Latitude and longitude, rad."""
    it = scenario()
    state = draw_initial_state(it.initial_error, build_trajectory(it), it.seed, [0])
    return float(state.position[0, 0]), float(state.position[0, 1])
