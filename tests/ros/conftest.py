"""A small map and short scenarios for the graph; every test worker has a ROS domain of its own."""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.domains import claim_domain
from helpers.field_scenarios import ALPS, GRADIENT, SCOTLAND
from helpers.node_bench import Bench, run_here
from isogal.fields.scenario_map import map_for_scenario
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.graph.domain import DOMAIN, participants

PATIENCE = 10.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all tests of this folder."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.ros)


@pytest.fixture(scope="session", autouse=True)
def domain() -> Iterator[int]:
    """A free domain, for this worker's tests and for the processes that they start; not that of
    who has started the tests, which all workers would share."""
    before = os.environ.pop(DOMAIN, None)
    with claim_domain() as number:
        os.environ[DOMAIN] = str(number)
        yield number
        del os.environ[DOMAIN]
    if before is not None:
        os.environ[DOMAIN] = before


@pytest.fixture(scope="module", autouse=True)
def nobody_is_left_behind(domain: int) -> Iterator[None]:
    """What a module starts in the worker's domain is gone at its end: the next one would hear it,
    and commands would stay out of the domain. Processes may take a while."""
    yield
    end = time.monotonic() + PATIENCE
    while (left := participants(domain)) and time.monotonic() < end:
        time.sleep(0.1)
    assert not left, f"{left} participants are left in ROS domain {domain}"


@pytest.fixture(scope="session")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rough disturbance map, 80 km on a side."""
    path = tmp_path_factory.mktemp("map") / "wavy.nc"
    write_netcdf(field_map_of(wavy, step=500.0), path)
    return path


@pytest.fixture(scope="session")
def settings(map_file: Path) -> Callable[..., list[str]]:
    """Overrides of a six-minute scenario over that map with six fixes, and more overrides. The
    map is made up: nothing is felt of it, which would cost its Fourier transform in each process
    that the simulator runs in."""

    def make(*more: str) -> list[str]:
        latitude, longitude = (float(x) * 57.29577951308232 for x in ORIGIN)
        return [
            f"route.start=[{latitude - 0.1}, {longitude - 0.1}]",
            f"route.end=[{latitude + 0.2}, {longitude + 0.2}]",
            "route.duration=360.0",
            "gravimeter.quantity=disturbance",
            "gravity.field=normal",
            f"map.source={map_file}",
            "matcher.name=pmht-paper",
            "matcher.batch_length=6",
            "matcher.stride=6",
            "matcher.map_sigma=0",
            *more,
        ]

    return make


@pytest.fixture(scope="session")
def scenario(settings: Callable[..., list[str]]) -> Callable[..., Scenario]:
    """The scenario itself."""
    return lambda *more: load_scenario(None, settings(*more))


@pytest.fixture(scope="session")
def flight(scenario: Callable[..., Scenario]) -> Callable[..., None]:
    """Tells a node on a bench what navigator and gravimeter say at a scan of the scenario."""
    trajectory, field_map = build_trajectory(scenario()), map_for_scenario(scenario())

    def say(
        made: Bench,
        scan: int,
        value: float | None = None,
        navigator: bool = True,
        north: float = 0.0,
        noise: float = 0.0,
        **keys: Any,
    ) -> None:
        k = scan * 10
        place = float(trajectory.latitude[k]), float(trajectory.longitude[k])
        if navigator:
            made.nav(k, place[0] + north, place[1], tuple(trajectory.velocity[k, :2]))
        found = float(field_map.value(*place)) + noise if value is None else value
        made.reading(k, found, **keys)

    return say


@pytest.fixture(scope="session")
def magnetic(shared_data: Path) -> Scenario:
    """Ten minutes with a magnetometer over a measured map."""
    return load_scenario(
        None, [*SCOTLAND, f"map.source={shared_data / 'scotland_magnetic_map.nc'}"]
    )


@pytest.fixture(scope="session")
def terrain(shared_data: Path) -> Scenario:
    """Ten minutes with a clearance meter over a measured map."""
    return load_scenario(None, [*ALPS, f"map.source={shared_data / 'se_australia_gravity.nc'}"])


@pytest.fixture(scope="session")
def gradient(scenario: Callable[..., Scenario]) -> Scenario:
    """Four minutes with a gradiometer that is not level and drifts, over the small map, which is
    wrong as one potential is."""
    return scenario(
        *GRADIENT,
        "route.duration=240.0",
        "map_error.sigma=2e-9",
        "matcher.map_sigma=2e-9",
        "gradiometer.map_errors=one_potential",
        "gradiometer.platform_tilt=1e-3",
        "gradiometer.platform_time=300",
        "gradiometer.bias_eotvos=2",
        "truth.gradiometer.bias_walk_eotvos=0.05",
    )


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory, scenario: Callable[..., Scenario]) -> Path:
    """A bag of the scenario, run in one process by the first worker that asks for it; the others
    wait."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "popen-gw" in base.name else base) / "made-recording"
    with Path(f"{folder}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            part = tmp_path_factory.mktemp("recording")
            run_here(scenario(), part / "bag")
            part.rename(folder)
    return folder / "bag"
