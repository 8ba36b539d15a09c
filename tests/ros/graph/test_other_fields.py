"""Magnetometer and clearance meter through the same nodes: single nodes with good and bad
messages, and the graph over real maps."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import MagneticField, Range
from typer.testing import CliRunner

from helpers.node_bench import bench, run_here, topics_of
from helpers.recordings import record, same
from isogal.cli.main import app
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.magnetometer import intensity
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.replay import replay
from isogal_ros.messages.stamps import from_seconds, set_stamp
from isogal_ros.nodes.health import OK, WARN
from isogal_ros.nodes.spin import Interrupt

pytestmark = pytest.mark.ros
ONE_IN_10000 = 18.4
"""Of a chi-square with two degrees of freedom."""
PLACE = np.radians([55.9, -3.9])
SHORT = ["route.duration=900.0", "matcher.batch_length=15", "initial_error.position=300.0"]
SCOTLAND = [
    "field=magnetic", "gravimeter.sigma=2.0",
    "route.start=[55.7, -4.6]", "route.end=[56.2, -3.6]", "route.height=300.0", "route.speed=40.0",
]  # fmt: skip
ALPS = [
    "field=terrain", "gravimeter.sigma=5.0",
    "route.start=[-36.9, 147.2]", "route.end=[-36.5, 148.2]", "route.height=2600.0", "route.speed=40.0",
]  # fmt: skip


@pytest.fixture(scope="module")
def magnetic(shared_data: Path) -> Scenario:
    return load_scenario(
        None, [*SHORT, *SCOTLAND, f"map.source={shared_data / 'scotland_magnetic_map.nc'}"]
    )


@pytest.fixture(scope="module")
def terrain(shared_data: Path) -> Scenario:
    return load_scenario(
        None, [*SHORT, *ALPS, f"map.source={shared_data / 'se_australia_gravity.nc'}"]
    )


@pytest.fixture(scope="module")
def bags(tmp_path_factory, magnetic, terrain) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bags")
    for scenario in (magnetic, terrain):
        run_here(scenario, folder / str(scenario.field))
    return {name: folder / name for name in ("magnetic", "terrain")}


@pytest.fixture(params=["magnetic", "terrain"])
def scenario(request) -> Scenario:
    return request.getfixturevalue(request.param)


def changed(scenario: Scenario, **sections: dict) -> Scenario:
    updates = {
        name: getattr(scenario, name).model_copy(update=update)
        for name, update in sections.items()
    }
    return scenario.model_copy(update=updates)


def horizontal(error) -> np.ndarray:
    return np.hypot(error[..., 0], error[..., 1])


class TestGraph:
    def test_it_is_the_closed_loop_of_the_library(self, bags, scenario) -> None:
        graph, library = record(bags[scenario.field], scenario), simulate(scenario, [0])
        same(graph, library, 1e-4)
        np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-6, rtol=0)

    def test_fixes_keep_the_error_small(self, bags, scenario) -> None:
        runs = record(bags[scenario.field], scenario)
        assert runs.fix_reason == ((None,) * 6,)
        assert horizontal(runs.error)[0, -1] < 60.0
        assert horizontal(runs.unaided_error)[0, -1] > 150.0
        normalised = np.einsum(
            "bi,bij,bj->b",
            runs.posterior_error[0],
            np.linalg.inv(runs.posterior_covariance[0]),
            runs.posterior_error[0],
        )
        assert normalised.max() < ONE_IN_10000

    def test_the_sensors_topics_are_recorded(self, bags, scenario) -> None:
        names = {"/" + topic.name.lstrip("/") for topic in topics_of(scenario.field)}
        assert {message.topic for message in BagReader(bags[scenario.field]).messages()} == names
        assert not any("gravimeter" in name for name in names)

    def test_a_replay_gives_the_same_fixes(self, bags, scenario) -> None:
        comparison = replay(
            BagReader(bags[scenario.field]), Interrupt(), lambda *_: None
        ).comparison
        assert comparison.recorded == comparison.replayed == comparison.common == 6
        assert comparison.disagreements == 0
        assert comparison.largest_difference < 1e-4

    def test_a_recording_can_be_matched_by_itself(self, scenario, tmp_path) -> None:
        # one batch, which ends with the run: until then nobody has corrected the navigator
        once = changed(scenario, route={"duration": 600.0}, matcher={"batch_length": 60})
        run_here(once, tmp_path / "bag")
        options = [
            "--map",
            scenario.map.source,
            "--track",
            str(tmp_path / "bag"),
            "--out",
            str(tmp_path / "x.json"),
        ]
        options += ["--prior-sigma", "500", "--velocity-sigma", "0.5", "--map-sigma", "0"]
        options += [] if scenario.field == "magnetic" else ["--variable", "height"]
        result = CliRunner().invoke(app, ["match", *options])
        assert result.exit_code == 0, result.output
        fixes = [
            fix for fix in json.loads((tmp_path / "x.json").read_text()) if fix["status"] == "fix"
        ]
        runs = record(tmp_path / "bag", once)
        assert [fix["time"] for fix in fixes] == [300.0, 600.0]
        for fix in fixes:
            k = int(np.flatnonzero(runs.time == fix["time"])[0])
            place = np.radians([fix["latitude"], fix["longitude"]])
            error = horizontal_difference(*place, runs.latitude[k], runs.longitude[k])[::-1]
            assert error @ np.linalg.solve(fix["covariance_enu"], error) < ONE_IN_10000
            assert np.hypot(*error) < 100.0 < np.hypot(*runs.unaided_error[0, k])

    def test_a_meter_out_of_range_makes_empty_scans(self, terrain, tmp_path) -> None:
        limited = changed(terrain, altimeter={"max_range": 1500.0}, route={"duration": 450.0})
        run_here(limited, tmp_path / "bag")
        graph, library = record(tmp_path / "bag", limited), simulate(limited, [0])
        none = np.isnan(graph.detail.reading)
        assert 0 < none.sum() < none.size
        np.testing.assert_array_equal(none, np.isnan(library.detail.reading))
        same(graph, library, 1e-4)

    def test_a_gravimeters_sigma_is_refused(self, magnetic) -> None:
        default = Scenario().gravimeter
        with pytest.raises(
            InputError, match=r"gravimeter\.sigma: must be in nT where field is magnetic"
        ):
            run_here(magnetic.model_copy(update={"gravimeter": default}), None)


def field_of(seconds, *vector, variance=0.0):
    message = MagneticField(
        magnetic_field_covariance=np.array([variance, 0, 0, 0, variance, 0, 0, 0, variance], float)
    )
    set_stamp(message.header.stamp, from_seconds(seconds))
    message.magnetic_field.x, message.magnetic_field.y, message.magnetic_field.z = map(
        float, vector
    )
    return message


def range_of(seconds, value, **keys):
    message = Range(range=float(value), min_range=1.0, max_range=3000.0, **keys)
    set_stamp(message.header.stamp, from_seconds(seconds))
    return message


class TestSensorNode:
    """gravimeter_node with simulate: false."""

    def test_a_magnetometers_readings_are_reduced(self, magnetic) -> None:
        main_field = float(intensity(*np.degrees(PLACE), 100.0, 2025.0))
        total = (main_field + 321.0) * 1e-9
        with bench(topics.GRAVIMETER, magnetic, simulate=False) as made:
            made.publish(
                topics.MAGNETIC_FIELD,
                field_of(10.0, 0.6 * total, 0.0, -0.8 * total, variance=9e-18),
            )
            made.nav(10.0, *PLACE)
            made.publish(topics.MAGNETIC_FIELD, field_of(20.0, 0.0, total, 0.0))
            made.nav(20.0, *PLACE)
            made.wait(lambda: len(made.heard["magnetometer/anomaly"]) == 2)
            known, unknown = made.heard["magnetometer/anomaly"]
            assert known.magnetic_field.z * 1e9 == pytest.approx(321.0, abs=0.02)
            assert known.header.frame_id == "main_field"
            # the sensor's, and the main field's gradient over the navigator's 30 m
            variances = [
                message.magnetic_field_covariance[8] * 1e18 for message in (known, unknown)
            ]
            assert 9.0 < variances[0] < 9.1
            assert variances[1] - 4.0 == pytest.approx(
                variances[0] - 9.0
            )  # unknown: gravimeter.sigma of 2 nT
            assert not made.heard["gravimeter/gravity"]

    def test_a_fast_instrument_gives_one_reading_per_scan(self, magnetic) -> None:
        with bench(topics.GRAVIMETER, magnetic, simulate=False) as made:
            for k in range(1, 81):
                made.publish(topics.MAGNETIC_FIELD, field_of(0.5 * k, 0.0, 0.0, 5e-5))
            for second in range(41):
                made.nav(second, *PLACE)
            made.wait(lambda: len(made.heard["magnetometer/anomaly"]) == 5)
            made.settle()
            scans = [message.header.stamp.sec for message in made.heard["magnetometer/anomaly"]]
            assert np.diff(scans).tolist() == [8, 10, 10, 10]
            assert not made.node.health.dropped
            assert made.node.health.figures["readings between scans"] == 75

    def test_a_clearance_meters_readings_are_reduced(self, terrain) -> None:
        with bench(topics.GRAVIMETER, terrain, simulate=False) as made:
            for seconds, message in (
                (10.0, range_of(10.0, 70.0, variance=4.0)),
                (20.0, range_of(20.0, math.inf)),
            ):
                made.publish(topics.CLEARANCE, message)
                made.nav(seconds, *PLACE)
            made.wait(lambda: len(made.heard["altimeter/terrain"]) == 2)
            ground, nothing = made.heard["altimeter/terrain"]
            assert ground.altitude == pytest.approx(30.0)  # the navigator is at 100 m
            assert ground.position_covariance[8] == pytest.approx(
                4.0 + 0.01
            )  # and its height is good to 0.1 m
            assert [ground.latitude, ground.longitude] == pytest.approx(np.degrees(PLACE))
            assert math.isnan(nothing.altitude)
            made.settle()
            level, _, figures = made.says()[-1]
            assert (level, figures["readings out of range"]) == (OK, "1")
            assert not made.node.health.dropped

    @pytest.mark.parametrize(
        ("field", "topic", "bad", "words"),
        [
            (
                "magnetic",
                topics.MAGNETIC_FIELD,
                lambda: field_of(20.0, math.nan, 0.0, 5e-5),
                "needs all three",
            ),
            (
                "magnetic",
                topics.MAGNETIC_FIELD,
                lambda: field_of(20.0, 0.0, 0.0, 50.0),
                "the unit is tesla",
            ),
            (
                "magnetic",
                topics.MAGNETIC_FIELD,
                lambda: field_of(20.0, 0.0, 0.0, 5e-5, variance=-1.0),
                "negative",
            ),
            (
                "magnetic",
                topics.MAGNETIC_FIELD,
                lambda: field_of(5.0, 0.0, 0.0, 5e-5),
                "not later than",
            ),
            ("terrain", topics.CLEARANCE, lambda: range_of(20.0, math.nan), "not a number"),
            (
                "terrain",
                topics.CLEARANCE,
                lambda: range_of(20.0, 70.0, variance=-1.0),
                "negative variance",
            ),
            ("terrain", topics.CLEARANCE, lambda: range_of(10.0, 70.0), "not later than"),
        ],
    )
    def test_bad_messages_are_dropped_and_said(self, request, field, topic, bad, words) -> None:
        good = {
            "magnetic": lambda t: field_of(t, 0.0, 0.0, 5e-5),
            "terrain": lambda t: range_of(t, 70.0),
        }[field]
        reduced = topics.readings(field).name
        with bench(topics.GRAVIMETER, request.getfixturevalue(field), simulate=False) as made:
            for seconds, message in ((10.0, good(10.0)), (20.0, bad()), (30.0, good(30.0))):
                made.publish(topic, message)
                made.nav(seconds, *PLACE)
            made.wait(lambda: len(made.heard[reduced]) == 2)
            made.wait(lambda: any(words in message for _, message, _ in made.says()), words)
            level, message, figures = next(item for item in made.says() if words in item[1])
            assert (level, figures[f"dropped {topic.name}"]) == (WARN, "1")
            assert topic.name in message


def test_the_matcher_drops_a_bad_anomaly_and_keeps_its_batch(magnetic) -> None:
    with bench(topics.PMHT_MM, magnetic) as made:
        for scan in range(1, 16):
            value = math.nan if scan == 4 else 50.0
            message = topics.ANOMALY.type()
            set_stamp(message.header.stamp, from_seconds(10.0 * scan))
            message.magnetic_field.z = value * 1e-9
            made.nav(10.0 * scan, PLACE[0] + 1e-5 * scan, PLACE[1] + 1e-5 * scan, (6.4, 3.6))
            made.publish(topics.ANOMALY, message)
        made.wait(lambda: made.heard["pmht_mm/fix"])
        assert made.node.health.dropped == {"magnetometer/anomaly": 1}
