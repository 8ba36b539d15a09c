"""Routes in belief space, against the bound along them and hand-made worlds."""

import json
import math

import numpy as np
import pytest
import yaml

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.errors import InputError
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.planning.areas import inside, read_areas
from isogal.evaluation.planning.files import write_path, write_route
from isogal.evaluation.planning.planner import RouteRequest, plan_route
from isogal.scenario import load_scenario, validate_scenario
from isogal.sensors.trajectory import build_trajectory

NORTH, EAST = 6.36e6, 6.37e6 * math.cos(ORIGIN[0])


def place(north, east):
    return ORIGIN[0] + north / NORTH, ORIGIN[1] + east / EAST


def rough_in_the_north(north, east):
    """Rough to the north of the straight way, flat on it."""
    return wavy(north, east) / (1.0 + np.exp(-(np.asarray(north) - 6e3) / 500.0))


FIELD = field_map_of(rough_in_the_north, half=45e3, step=500.0)
START, GOAL = place(0.0, -30e3), place(0.0, 30e3)
TRUTH = validate_scenario(
    {"gravimeter": {"quantity": "disturbance"}, "gravity": {"field": "normal"}}
).true


@pytest.fixture(scope="module")
def planned():
    return plan_route(TRUTH, FIELD, RouteRequest(START, GOAL))


def test_it_goes_where_the_field_is_rough(planned):
    assert planned.route.error < 0.7 * planned.straight.error
    assert planned.straight.length < planned.route.length < 1.155 * planned.straight.length
    assert ((planned.route.waypoints[:, 0] - ORIGIN[0]) * NORTH).max() > 5e3
    np.testing.assert_allclose(planned.route.waypoints[[0, -1]], [START, GOAL], atol=1e-12)


def test_a_short_route_has_corners_that_the_vehicle_can_turn_round():
    """Edges shorter than its turning circle made it go round in circles, for six times the way."""
    ends, rough = (place(0.0, -8e3), place(0.0, 8e3)), field_map_of(wavy, half=30e3, step=500.0)
    found = plan_route(TRUTH, rough, RouteRequest(*ends))
    assert found.route.length < 1.155 * found.straight.length
    turned = np.unwrap(np.arctan2(*found.route.trajectory.velocity[:, 1::-1].T))
    assert np.ptp(turned) < math.pi


def test_what_it_promises_is_the_bound_of_the_route_that_it_writes(planned, tmp_path):
    write_route(planned.route, tmp_path / "route.yaml")
    scenario = load_scenario(
        tmp_path / "route.yaml", ["gravimeter.quantity=disturbance", "gravity.field=normal"]
    )
    bound = posterior_cramer_rao(scenario.true, build_trajectory(scenario), FIELD)
    assert bound.rms[-1] == pytest.approx(planned.route.error, rel=1e-3)


def test_a_ceiling_gives_a_shorter_route(planned):
    ceiling = 0.5 * (planned.route.error + planned.straight.error)
    found = plan_route(TRUTH, FIELD, RouteRequest(START, GOAL, ceiling=ceiling)).route
    assert found.error <= ceiling
    assert found.length < planned.route.length


def square(north, east, half):
    """Corners (5, 2) as GeoJSON has them: longitude and latitude, deg."""
    corners = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
    places = [place(north + n, east + e) for n, e in corners]
    return [[math.degrees(lon), math.degrees(lat)] for lat, lon in places]


def area_of(tmp_path, *square_of):
    path = tmp_path / "areas.geojson"
    geometry = {"type": "MultiPolygon", "coordinates": [[square(*square_of)]]}
    feature = {"type": "Feature", "properties": {}, "geometry": geometry}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return tuple(read_areas(path))


def test_it_keeps_out_of_areas(tmp_path):
    areas = area_of(tmp_path, 5e3, 0.0, 6e3)
    plan = plan_route(TRUTH, FIELD, RouteRequest(START, GOAL, 0.3, areas=areas))
    assert plan.straight is None
    track = plan.route.trajectory
    # corners are cut by the turn's radius
    inner = area_of(tmp_path, 5e3, 0.0, 5e3)
    assert not inside(inner, track.latitude, track.longitude).any()


@pytest.mark.parametrize(
    ("area", "request_of", "message"),
    [
        ((0.0, 10e3, 39e3), {}, "start lies in an area|goal lies in an area"),
        ((0.0, 0.0, 25e3), {}, "the goal cannot be reached"),
        (None, {"goal": place(0.0, -29e3)}, "a route needs"),
        (None, {"detour": 0.05, "ceiling": 1.0}, "below 1 m; the best has"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, area, request_of, message):
    areas = {} if area is None else {"areas": area_of(tmp_path, *area)}
    with pytest.raises(InputError, match=message):
        plan_route(
            TRUTH, FIELD, RouteRequest(**{"start": START, "goal": GOAL, **areas, **request_of})
        )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ('{"type": "FeatureCollection", "features": []}', "has no polygon"),
        ('{"type": "Polygon"}', "is not GeoJSON"),
    ],
)
def test_bad_areas_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.geojson"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_areas(path)


def test_a_path_faces_along_itself(planned, tmp_path):
    write_path(planned.route, tmp_path / "path.yaml")
    poses = yaml.safe_load((tmp_path / "path.yaml").read_text())["poses"]
    first, last = (poses[k]["pose"]["position"] for k in (0, -1))
    assert (first["x"], first["y"]) == pytest.approx((0.0, 0.0), abs=0.01)
    assert last["x"] == pytest.approx(60e3, rel=0.01)
    a, b = (poses[k]["pose"] for k in (10, 11))
    turn = 2.0 * math.atan2(a["orientation"]["z"], a["orientation"]["w"])
    course = math.atan2(
        b["position"]["y"] - a["position"]["y"], b["position"]["x"] - a["position"]["x"]
    )
    assert math.remainder(turn - course, 2.0 * math.pi) == pytest.approx(0.0, abs=0.3)
