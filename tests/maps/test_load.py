"""The map that a scenario means."""

import numpy as np
import pytest

from helpers.map_files import refused
from helpers.refusals import refusal
from isogal.fields.scenario_map import map_for_scenario
from isogal.maps.load import check_coverage, load_map
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


def scenario(shared_data, *overrides):
    source = f"map.source={shared_data / 'se_australia_gravity.nc'}"
    return load_scenario(overrides=[source, "route.duration=1800", *overrides])


@pytest.mark.parametrize(
    ("quantity", "more"), [("gravity", ["map.variable=ga"]), ("disturbance", [])]
)
def test_variable_by_quantity_along_the_route(shared_data, quantity, more):
    path = f"map.path={shared_data / 'se_australia_gravity.nc'}"
    chosen = scenario(
        shared_data, "map.source=netcdf", path, f"gravimeter.quantity={quantity}", *more
    )
    trajectory = build_trajectory(chosen)
    field_map = map_for_scenario(chosen, trajectory)
    assert field_map.quantity == quantity and field_map.unit == "m/s²"
    assert field_map.covers(trajectory.latitude, trajectory.longitude).all()
    assert field_map.values.size < 20_000  # the corridor, not the file
    assert map_for_scenario(chosen, margin=2_000.0).values.size < field_map.values.size


@pytest.mark.parametrize(
    "overrides,words",
    [
        (["map.variable=dg"], "is a disturbance map, and one of gravity is needed"),
        (["map.variable=nix"], "has no grid 'nix'; it has dg (disturbance), ga"),
        (
            ["route.start=[-34.6,145]", "route.end=[-33,145]", "route.duration=null"],
            "does not cover the route: no value at -34.5",
        ),
        (["route.start=[10,20]", "route.end=[11,20]"], "has nothing at"),
        (["map.path=x.nc"], "map.source: must be"),
    ],
)
def test_refusals(shared_data, overrides, words):
    with refusal(words):
        map_for_scenario(scenario(shared_data, *overrides))


def test_missing_and_unknown_files(tmp_path):
    (tmp_path / "map.docx").write_text("?")
    for name, asked, words in (
        ("nix.nc", {}, "no such file"),
        ("map.docx", {}, "not a known map format"),
        ("map.docx", {"format_name": "nix"}, "unknown map format 'nix'"),
    ):
        assert words in refused(tmp_path / name, **asked)
    with refusal("map.source: must be"):
        map_for_scenario(load_scenario(overrides=["map.source=netcdf"]))


def test_the_first_route_point_without_a_value_is_named(shared_data):
    field_map = load_map(shared_data / "clear_lake_gravity_map.nc")
    latitude, longitude = np.radians([38.8, 38.8, 39.9]), np.radians([-122.7, -122.7, -122.7])
    check_coverage(field_map, latitude[:2], longitude[:2])
    with refusal("no value at 39.9000, -122.7000 deg (point 2 of 3; 1 points have none)"):
        check_coverage(field_map, latitude, longitude)
