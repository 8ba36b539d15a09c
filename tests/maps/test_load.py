"""The map that a scenario means."""

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.fields.scenario_map import map_for_scenario
from isogal.maps.corridor import corridor_of
from isogal.maps.load import check_coverage, load_map
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


def scenario(shared_data, *overrides, file="se_australia_gravity.nc"):
    return load_scenario(
        overrides=[f"map.source={shared_data / file}", "route.duration=1800", *overrides]
    )


@pytest.mark.parametrize(
    "quantity,variable",
    [("gravity", None), ("gravity", "ga"), ("disturbance", None), ("disturbance", "dg")],
)
def test_variable_by_quantity(shared_data, quantity, variable):
    extra = [f"map.variable={variable}"] if variable else []
    chosen = scenario(shared_data, f"gravimeter.quantity={quantity}", *extra)
    trajectory = build_trajectory(chosen)
    field_map = map_for_scenario(chosen, trajectory)
    assert field_map.quantity == quantity and field_map.unit == "m/s²"
    assert field_map.covers(trajectory.latitude, trajectory.longitude).all()
    assert field_map.values.size < 20_000  # the corridor, not the file
    np.testing.assert_array_equal(map_for_scenario(chosen).values, field_map.values)


def test_margin(shared_data):
    chosen = scenario(shared_data)
    trajectory = build_trajectory(chosen)
    found = corridor_of(trajectory.latitude, trajectory.longitude, 10_000.0).window
    assert (trajectory.latitude.min() - found.south) * 6.371e6 == pytest.approx(10_000.0)
    assert (found.east - trajectory.longitude.max()) * 6.371e6 * np.cos(
        found.south
    ) == pytest.approx(10_000.0, rel=0.01)
    small, large = (map_for_scenario(chosen, trajectory, m) for m in (2_000.0, 20_000.0))
    assert small.values.size < large.values.size


@pytest.mark.parametrize(
    "overrides,words",
    [
        (["map.variable=dg"], "is a disturbance map, but gravimeter.quantity is gravity"),
        (["map.variable=nix"], "no variable 'nix'; it has dg, ga"),
        (
            ["route.start=[-34.6,145]", "route.end=[-33,145]", "route.duration=null"],
            "does not cover the route: no value at -34.5",
        ),
        (["route.start=[10,20]", "route.end=[11,20]"], "has nothing at"),
        (["map.path=x.nc"], "map.source: must be"),
    ],
)
def test_refusals(shared_data, overrides, words):
    with pytest.raises(InputError) as error:
        map_for_scenario(scenario(shared_data, *overrides))
    assert words in str(error.value) and "\n" not in str(error.value)


def test_missing_and_unknown_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_map(tmp_path / "nix.nc")
    (tmp_path / "map.docx").write_text("?")
    with pytest.raises(InputError, match="not a known map format"):
        load_map(tmp_path / "map.docx")
    with pytest.raises(InputError, match="unknown map format 'nix'"):
        load_map(tmp_path / "map.docx", format_name="nix")
    with pytest.raises(InputError, match=r"map\.path: must name"):
        map_for_scenario(load_scenario(overrides=["map.source=netcdf"]))


def test_source_may_name_the_format(shared_data):
    by_name = load_scenario(
        overrides=[
            "map.source=netcdf",
            f"map.path={shared_data / 'se_australia_gravity.nc'}",
            "route.duration=600",
        ]
    )
    assert map_for_scenario(by_name).quantity == "gravity"


def test_the_first_route_point_without_a_value_is_named(shared_data):
    field_map = load_map(shared_data / "clear_lake_gravity_map.nc")
    latitude, longitude = np.radians([38.8, 38.8, 39.9]), np.radians([-122.7, -122.7, -122.7])
    check_coverage(field_map, latitude[:2], longitude[:2])
    with pytest.raises(
        InputError,
        match=r"no value at 39\.9000, -122\.7000 deg \(point 2 of 3; 1 points have none\)",
    ):
        check_coverage(field_map, latitude, longitude)
