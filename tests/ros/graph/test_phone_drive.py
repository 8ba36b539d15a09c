"""A drive that a phone has logged: from its file through a recording and the nodes."""

import math
import shutil
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.scenario import changed_scenario, load_scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.player import Player, load

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "examples" / "phone_drive"), str(ROOT / "benchmarks")]

import drives  # noqa: E402
from phone_bag import write_bag  # noqa: E402
from phone_log import read_drive  # noqa: E402
from road_heights import main as road_heights  # noqa: E402

SATELLITES, END = 120.0, 300
LATITUDE, LONGITUDE = 40.0, -75.0
QUICK = ["matcher.batch_length=10"]


def terrain(north: np.ndarray, east: np.ndarray) -> np.ndarray:
    """m, at places in m."""
    return 60.0 + 25.0 * np.sin(north / 900.0) + 20.0 * np.cos(east / 700.0 + north / 1500.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """A car that drives curves at 15 m/s; the phone stands upright, askew in its holder."""
    path = tmp_path_factory.mktemp("phone") / "drive.nc"
    random = np.random.default_rng(5)
    t = np.arange(END + 1.0)
    speed = np.clip(15.0 * np.minimum(1.0, (t - 5.0) / 20.0), 0.0, None)
    turn = np.where(speed > 5.0, 0.04 * np.sin(t / 17.0), 0.0)
    mean = 0.5 * (speed[1:] + speed[:-1])
    course = 0.7 + np.concatenate([[0.0], np.cumsum(0.5 * (turn[1:] + turn[:-1]))])
    middle = 0.5 * (course[1:] + course[:-1])
    north, east = (
        np.concatenate([[0.0], np.cumsum(mean * side)])
        for side in (np.cos(middle), np.sin(middle))
    )
    height = terrain(north, east)
    level = np.column_stack([np.gradient(speed), speed * turn])
    askew = 0.5  # rad, of the phone's right from the car's
    cos, sin = math.cos(askew), math.sin(askew)
    forward, right = level.T
    columns = {
        "acc_x": cos * right - sin * forward,
        "acc_y": np.full(len(t), 9.81),
        "acc_z": -cos * forward - sin * right,
        **dict.fromkeys(("gyro_x", "gyro_z", "grav_x", "grav_z"), np.zeros(len(t))),
        "gyro_y": -turn + 1e-4,
        "grav_y": np.full(len(t), 9.81),
        "pressure": 1013.25 * (1.0 - height / 44330.8) ** 5.25588,
        "speed": speed,
        "bearing": np.degrees(course) % 360.0,
        "latitude": LATITUDE + np.degrees(north / 6.37e6),
        "longitude": LONGITUDE + np.degrees(east / (6.388e6 * math.cos(math.radians(LATITUDE)))),
        "altitude": height,
        "horizontalAccuracy": np.full(len(t), 3.0),
        "speedAccuracy": np.full(len(t), 0.2),
        "bearingAccuracy": np.full(len(t), 1.0),
    }
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", len(t))
        clock = file.createVariable("time", "i8", ("time",))
        clock.units, clock.calendar = "seconds since 2025-03-01 15:00:00", "standard"
        clock[:] = t
        for name, values in columns.items():
            noise = {"acc": 0.05, "gyr": 1e-4, "pre": 0.02}.get(name[:3], 0.0)
            data = file.createVariable(name, "f8", ("time",))
            data[:] = values + noise * random.standard_normal(len(t))
    return path


@pytest.fixture(scope="module")
def roads(tmp_path_factory) -> Path:
    """The terrain, 200 m from node to node, with its error."""
    folder, metres = tmp_path_factory.mktemp("roads"), np.arange(-6000.0, 6001.0, 200.0)
    latitude = math.radians(LATITUDE) + metres / 6.37e6
    longitude = math.radians(LONGITUDE) + metres / (6.388e6 * math.cos(latitude[30]))
    heights = terrain(metres[:, None], metres)
    made = FieldMap(latitude, longitude, heights, "m", "height")
    write_netcdf(made, folder / "terrain.nc")
    with pytest.MonkeyPatch.context() as patch:
        words = "road_heights.py", str(folder / "terrain.nc"), str(folder / "roads.nc")
        patch.setattr(sys, "argv", [*words])
        road_heights()
    return folder / "roads.nc"


@pytest.mark.parametrize(
    ("sensor", "unit", "factor", "words"),
    [
        ("acc", "g", 9.81, "must be 9.8 m/s²"),
        ("gyro", "deg/s", math.pi / 180.0, "must be in rad/s"),
    ],
)
def test_units_of_a_log(log, tmp_path, sensor, unit, factor, words) -> None:
    """Another one counts where it is said, and is refused where it is not."""
    other = shutil.copy(log, tmp_path / "other.nc")
    with netCDF4.Dataset(other, "a") as file:
        for axis in "xyz":
            file[f"{sensor}_{axis}"][:] /= factor
    with pytest.raises(InputError, match=words) as refused:
        read_drive(other)
    assert str(refused.value).startswith(str(other))
    with netCDF4.Dataset(other, "a") as file:
        for axis in "xyz":
            file[f"{sensor}_{axis}"].units = unit
    np.testing.assert_allclose(
        read_drive(other).force, read_drive(log).force, rtol=1e-3, atol=1e-2
    )
    with netCDF4.Dataset(other, "a") as file:
        file[f"{sensor}_x"].units = "stone"
    with pytest.raises(InputError, match="unknown unit 'stone'"):
        read_drive(other)


def test_the_nodes_navigate_it_as_the_library_does(log, roads, tmp_path) -> None:
    drive = read_drive(log, SATELLITES)
    write_bag(drive, tmp_path / "bag", SATELLITES)
    # after the satellites the recording has their speed alone
    newest = {one.topic: one.log_ns for one in BagReader(tmp_path / "bag").messages()}
    assert newest["/gnss/fix"] == newest["/gnss/velocity"] == (SATELLITES - 1.0) * 1e9
    assert newest["/velocity/data_raw"] == newest["/imu/data_raw"] == END * 1e9
    car = load_scenario(ROOT / "examples" / "phone_drive" / "car.yaml")
    scenario = changed_scenario(car, [f"map.source={roads}", *QUICK], "--set")
    player = Player(load(BagReader(tmp_path / "bag"), scenario), {}, {})
    filter_node = player.nodes[topics.UKF_FUSION]
    player.play()
    assert filter_node.health.figures["velocity/data_raw used"] > END - 40
    assert filter_node.health.figures["aligned"]
    terrain_map = drives.load_map(roads, "height")
    navigator = drives.navigator_of(drive, scenario, terrain_map)
    rows = drives.navigate(navigator, drive, scenario, True, SATELLITES)
    assert rows[-1, 1] < 300.0
    fixes = [one for one in player.collector.fix_positions().values() if one is not None]
    assert len(fixes) > 1
    by_library, by_nodes = navigator.state, filter_node.navigator.state
    apart = 6.4e6 * (by_library.position - by_nodes.position)[:2]
    assert np.hypot(*apart) < 1e-3
    np.testing.assert_allclose(by_library.covariance, by_nodes.covariance, rtol=1e-5, atol=1e-6)
