"""Adapters by the name of their field, also those of other packages."""

import math

import pytest

from isogal import plugins
from isogal.errors import InputError
from isogal.fields.measured import fields
from isogal.scenario import load_scenario
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.messages.adapter import adapter_of, all_topics, topics_in_use
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import from_seconds, to_ns

VALUE = {"gravity": 9.8, "disturbance": 3e-4, "magnetic": -123.4, "terrain": 456.7}
RAW = {"gravity": 9.797, "disturbance": 9.797, "magnetic": 50123.4, "terrain": 543.25}
SOIL = """
from std_msgs.msg import Header
from isogal.fields.measured import MeasuredField
from isogal.sensors.gravimeter import GravityReduction
from isogal_ros.topics import Topic

class Adapter:
    raw = Topic("probe/data_raw", Header)
    reduced = Topic("probe/moisture", Header)
    def __init__(self, scenario):
        self.seed = scenario.seed

SOIL = MeasuredField(
    "soil", "probe", "gravity", "m/s²", 0.0, 1.0, lambda scenario: GravityReduction()
)
"""


@pytest.fixture
def soil(tmp_path, monkeypatch):
    """A field of another package, with its messages."""
    (tmp_path / "soil.py").write_text(SOIL)
    metadata = tmp_path / "soil-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: soil\n")
    (metadata / "entry_points.txt").write_text(
        "[isogal.fields]\nsoil = soil:SOIL\n[isogal.message_adapters]\nsoil = soil:Adapter\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    plugins._installed.cache_clear()
    plugins._registered.cache_clear()
    yield load_scenario(None, ["seed=3", "field=soil"])
    plugins._installed.cache_clear()
    plugins._registered.cache_clear()


def test_every_field_has_its_messages() -> None:
    assert set(plugins.names(plugins.MESSAGE_ADAPTERS)) == set(fields())
    for name, field in fields().items():
        adapter = adapter_of(load_scenario(), name)
        assert (adapter.raw is topics.FELT) == (field.instrument == "gravimeter")


def test_the_scenario_says_which_field() -> None:
    assert adapter_of(load_scenario()).reduced is topics.GRAVITY
    assert adapter_of(load_scenario(None, ["field=terrain"])).reduced is topics.TERRAIN


def test_a_field_of_another_package_brings_its_topics(soil) -> None:
    adapter = adapter_of(soil)
    assert adapter.seed == 3
    assert all_topics(soil) == (*topics.ALL, adapter.raw, adapter.reduced)
    assert adapter.reduced in Collector(soil).topics()


def test_a_field_without_messages_is_an_error() -> None:
    with pytest.raises(InputError, match="unknown message adapter 'soil'; allowed: disturbance"):
        adapter_of(load_scenario(), "soil")


@pytest.mark.parametrize("name", VALUE)
def test_both_ways(name) -> None:
    adapter = adapter_of(load_scenario(), name)
    ns = from_seconds(12.5)
    raw, reduced = adapter.new_raw(), adapter.new_reduced()
    assert isinstance(raw, adapter.raw.type)
    assert isinstance(reduced, adapter.reduced.type)
    adapter.fill_raw(raw, ns, RAW[name], 0.25)
    value, variance = adapter.read_raw(raw)
    assert (value, variance) == (
        pytest.approx(RAW[name], rel=1e-14),
        pytest.approx(0.25, rel=1e-14),
    )
    adapter.fill_reduced(reduced, ns, VALUE[name], 0.5, (-0.6, 2.5))
    assert adapter.read_reduced(reduced) == pytest.approx((VALUE[name], 0.5), rel=1e-14)
    assert to_ns(raw.header.stamp) == to_ns(reduced.header.stamp) == ns


@pytest.mark.parametrize("name", VALUE)
def test_reduced_readings_that_cannot_be_used(name) -> None:
    adapter = adapter_of(load_scenario(), name)
    for value, variance, words in (
        (math.inf, 1.0, "not finite"),
        (1.0, math.nan, "not finite"),
        (1.0, -1.0, "negative"),
    ):
        message = adapter.new_reduced()
        adapter.fill_reduced(message, 0, value, variance, (0.0, 0.0))
        with pytest.raises(BadMessageError, match=words):
            adapter.read_reduced(message)


def test_topics_of_sensors_that_are_not_there_are_not_in_use() -> None:
    plain = set(topics_in_use(load_scenario()))
    assert {topics.FELT, topics.GRAVITY, topics.DISTURBANCE, topics.POSE} <= plain
    assert not plain & {topics.TERRAIN, topics.SCALAR_FIELD, topics.BAROMETER, topics.VELOCITY}
    aided = load_scenario(None, ["height.source=barometer", "velocity.kind=log"])
    assert {topics.BAROMETER, topics.VELOCITY} <= set(topics_in_use(aided))
    magnetic = set(topics_in_use(load_scenario(None, ["field=magnetic", "gravimeter.sigma=1"])))
    assert {topics.MAGNETIC_FIELD, topics.SCALAR_FIELD, topics.ANOMALY} <= magnetic
    assert topics.GRAVITY not in magnetic
