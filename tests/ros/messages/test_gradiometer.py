"""The gradiometer through the nodes: its messages, single nodes with bad ones, the graph, and what
is refused before it starts."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from typer.testing import CliRunner

from helpers.node_bench import bench, run_here, topics_of
from helpers.recordings import record, same
from isogal.cli.main import app
from isogal.earth.gravity import normal_gradient
from isogal.montecarlo.engine import simulate
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.replay import replay
from isogal_ros.messages.gradiometer import GRADIOMETER, GradiometerAdapter
from isogal_ros.messages.readings import ADAPTERS, adapter_of
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_ns
from isogal_ros.nodes.health import BadMessageError
from isogal_ros.nodes.spin import Interrupt

pytestmark = pytest.mark.ros
VALUE = np.array([1.5e-8, math.nan, -3.2e-7])
COVARIANCE = 1e-18 * np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.0], [0.5, 0.0, 2.0]])
NAMES = ("nn", "ed", "dd")
GRADIENT = (
    "gravimeter.quantity=gravity", "field=gradient", "matcher.name=pmht", "gradiometer.components=[ne, nd, ed]",
    "gradiometer.covariance_eotvos=[[4, 1, 0], [1, 4, 0], [0, 0, 9]]", "initial_error.position=300.0",
)  # fmt: skip


def message(seconds, values, covariance=None, names=NAMES):
    adapter = GradiometerAdapter(names)
    made = adapter.new_raw(None)
    covariance = 1e-18 * np.eye(len(names)) if covariance is None else covariance
    adapter.fill_raw(made, from_seconds(seconds), np.asarray(values, float), covariance)
    return made


class TestMessages:
    def test_both_ways(self) -> None:
        made = message(12.5, VALUE, COVARIANCE)
        value, covariance = GradiometerAdapter(NAMES).read_reduced(made)
        np.testing.assert_array_equal(value, VALUE)
        np.testing.assert_array_equal(covariance, COVARIANCE)
        assert to_ns(made.header.stamp) == from_seconds(12.5)
        assert made.header.frame_id == GRADIOMETER
        assert [field.name for field in made.fields] == ["T_nn", "T_ed", "T_dd", "covariance"]
        assert (made.width, made.height, made.is_dense, len(made.data)) == (
            1,
            1,
            False,
            made.point_step,
        )

    def test_components_go_by_their_names(self) -> None:
        value, covariance = GradiometerAdapter(("dd", "nn")).read_reduced(
            message(1.0, VALUE, COVARIANCE)
        )
        np.testing.assert_array_equal(value, VALUE[[2, 0]])
        np.testing.assert_array_equal(covariance, COVARIANCE[np.ix_([2, 0], [2, 0])])

    def test_the_other_byte_order(self) -> None:
        made = message(1.0, VALUE, COVARIANCE)
        made.data = np.frombuffer(bytes(made.data), "<f8").astype(">f8").tobytes()
        made.is_bigendian = True
        np.testing.assert_array_equal(GradiometerAdapter(NAMES).read_raw(made)[0], VALUE)

    def test_a_covariance_of_zero_is_an_unknown_one(self) -> None:
        assert GradiometerAdapter(NAMES).read_raw(message(1.0, VALUE, np.zeros((3, 3))))[1] is None

    def test_the_scenario_says_the_components(self, scenario) -> None:
        assert adapter_of(scenario(*GRADIENT)).components == ("ne", "nd", "ed")
        assert adapter_of(scenario(), "terrain") is ADAPTERS["terrain"]

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                lambda m: m.header.__setattr__("frame_id", "map"),
                "frame_id must be 'gradiometer_link'",
            ),
            (lambda m: m.fields.pop(0), "no field T_nn; fields are T_ed, T_dd, covariance"),
            (lambda m: m.fields.pop(), "no field covariance"),
            (lambda m: setattr(m, "fields", []), r"fields are \(none\)"),
            (
                lambda m: setattr(m.fields[0], "datatype", PointField.FLOAT32),
                "field T_nn must be 1 x float64",
            ),
            (lambda m: setattr(m.fields[3], "count", 4), "field covariance must be 9 x float64"),
            (
                lambda m: setattr(m, "data", bytes(m.data)[:-8]),
                "field covariance lies beyond the end of the data",
            ),
            (
                lambda m: setattr(m.fields[1], "offset", 4_000_000_000),
                "field T_ed lies beyond the end",
            ),
            (lambda m: setattr(m, "width", 2), "must hold one point, holds 2"),
        ],
    )
    def test_what_cannot_be_read(self, change, words) -> None:
        made = message(1.0, VALUE, COVARIANCE)
        change(made)
        with pytest.raises(BadMessageError, match=words):
            GradiometerAdapter(NAMES).read_raw(made)

    @pytest.mark.parametrize(
        ("value", "covariance", "words"),
        [
            ([30.0, 1.0, 1.0], COVARIANCE, "the unit is 1/s²"),
            ([math.inf, 0.0, 0.0], COVARIANCE, "the unit is 1/s²"),
            (VALUE, -COVARIANCE, "negative variance"),
            (VALUE, math.nan * COVARIANCE, "covariance is not finite"),
        ],
    )
    def test_what_is_not_of_the_earth(self, value, covariance, words) -> None:
        with pytest.raises(BadMessageError, match=words):
            GradiometerAdapter(NAMES).read_reduced(message(1.0, value, covariance))


@pytest.fixture(scope="module")
def recorded(scenario, tmp_path_factory):
    bag = tmp_path_factory.mktemp("gradient") / "bag"
    made = scenario(*GRADIENT)
    run_here(made, bag)
    return made, bag


class TestGraph:
    def test_it_is_the_closed_loop_of_the_library(self, recorded) -> None:
        made, bag = recorded
        graph, library = record(bag, made), simulate(made, [0])
        same(graph, library, 1e-4)
        np.testing.assert_allclose(
            graph.detail.reading, library.detail.reading, atol=1e-6 * 1e-9, rtol=0
        )
        assert graph.fix_reason == ((None,) * 10,)
        assert np.hypot(*graph.error[0, -1]) < 60.0 < np.hypot(*graph.unaided_error[0, -1])

    def test_the_instruments_topics_are_recorded(self, recorded) -> None:
        bag = recorded[1]
        names = {"/" + topic.name.lstrip("/") for topic in topics_of("gradient")}
        assert {item.topic for item in BagReader(bag).messages()} == names
        assert {"/gradiometer/data_raw", "/gradiometer/gradient"} <= names

    def test_a_replay_gives_the_same_fixes(self, recorded) -> None:
        comparison = replay(BagReader(recorded[1]), Interrupt(), lambda *_: None).comparison
        assert comparison.recorded == comparison.replayed == comparison.common == 10
        assert comparison.largest_difference < 1e-4

    def test_retrodiction_has_one_fix_for_each_scan(self, scenario, tmp_path) -> None:
        made = scenario(*GRADIENT, "matcher.mode=retrodiction", "route.duration=300.0")
        run_here(made, tmp_path / "bag")
        stamps = [
            item for item in BagReader(tmp_path / "bag").messages() if item.topic == "/pmht_mm/fix"
        ]
        assert len(stamps) == 30
        same(record(tmp_path / "bag", made), simulate(made, [0]), 1e-4, fixes=False)


class TestNodes:
    def test_readings_of_an_instrument_are_reduced(self, scenario) -> None:
        place = np.radians([-36.5, 147.0])
        normal = normal_gradient(place[0], 100.0)
        with bench(topics.GRAVIMETER, scenario(*GRADIENT), simulate=False) as made:
            felt = [normal[0, 1] + 4e-8, normal[0, 2] - 2e-8, math.nan]
            made.publish(topics.FULL_GRADIENT, message(10.0, felt, names=("ne", "nd", "ed")))
            made.nav(10.0, *place)
            made.publish(
                topics.FULL_GRADIENT, message(20.0, [math.nan] * 3, names=("ne", "nd", "ed"))
            )
            made.nav(20.0, *place)
            made.wait(lambda: len(made.heard["gradiometer/gradient"]) == 2)
            read = adapter_of(made.scenario).read_reduced
            value, covariance = read(made.heard["gradiometer/gradient"][0])
            np.testing.assert_allclose(value, [4e-8, -2e-8, math.nan], atol=1e-14)
            np.testing.assert_array_equal(covariance, 1e-18 * np.eye(3))
            assert np.isnan(read(made.heard["gradiometer/gradient"][1])[0]).all()
            made.wait(
                lambda: any(
                    figures.get("readings out of range") == "1" for _, _, figures in made.says()
                )
            )

    def test_a_bad_message_is_dropped_and_its_scan_is_empty(self, scenario) -> None:
        with bench(topics.PMHT_MM, scenario(*GRADIENT)) as made:
            for scan in range(1, 7):
                if scan == 3:
                    item = PointCloud2(width=1, height=1)
                    item.header.frame_id = GRADIOMETER
                    set_stamp(item.header.stamp, from_seconds(10.0 * scan))
                else:
                    item = message(10.0 * scan, [1e-8, 2e-8, 0.0], names=("ne", "nd", "ed"))
                made.nav(10.0 * scan, np.radians(-36.5) + 2e-5 * scan, np.radians(147.0))
                made.publish(topics.GRADIENT, item)
            made.wait(lambda: made.heard["pmht_mm/fix"])
            assert made.node.health.dropped == {"gradiometer/gradient": 1}


class TestRefused:
    """By `isogal run`, before any node has started."""

    @pytest.mark.parametrize(
        ("overrides", "words"),
        [
            (["gradiometer.components=[nn, up]"], "unknown 'up'; allowed: nn, ne, nd, ee, ed, dd"),
            (["gradiometer.covariance_eotvos=null", "gradiometer.sigma_eotvos=0"], "should be greater than 0"),
            (["gravimeter.sigma=1e-9"], "gravimeter.sigma: says nothing where field is gradient"),
            (["map.source=synthetic", "map.variable=ga"], "field is gradient, which needs one of disturbance"),
            (["matcher.name=tercom"], "tercom takes one number per scan; for readings of several channels give pmht"),
            (["matcher.map_sigma=auto"], "matcher.map_sigma: auto is for scalar fields"),
            (["route.height=-10"], "route.height: must be >= 0 m where field is gradient"),
            (["field=terrain", "gravimeter.sigma=5", "map.source=synthetic", "route.height=1"],
             "route.height: the vehicle is"),
        ],
    )  # fmt: skip
    @pytest.mark.parametrize("verb", ["run", "montecarlo"])
    def test_in_one_line(self, settings, tmp_path, verb, overrides, words) -> None:
        options = [item for text in (*settings(*GRADIENT), *overrides) for item in ("--set", text)]
        result = CliRunner().invoke(
            app,
            [verb, *options, "--out", str(tmp_path / "out"), *(["--runs", "1"] * (verb != "run"))],
        )
        assert result.exit_code != 0
        said = str(result.exception) + result.output
        assert words in said
        assert "Four nodes" not in said
        assert not (tmp_path / "out" / "bag").exists()
