"""Parameters of a node: declared, checked, changed while it runs."""

import pytest
from rclpy.parameter import Parameter

from helpers.domains import claim_domain
from isogal.errors import InputError
from isogal_ros.graph.domain import local_context
from isogal_ros.nodes.base import GraphNode


class Probe(GraphNode):
    """A node with three sections; two parameters of one may change."""

    sections = ("gravimeter", "matcher", "imu")
    mutable = ("matcher.bias_sigma", "matcher.map_sigma")

    def setup(self) -> None:
        self.seen: list[dict] = []

    def changed(self, values: dict) -> None:
        if values.get("matcher.bias_sigma", 0.0) > 1.0:
            raise InputError("a bias of more than 1 m/s² is no gravimeter's")
        self.seen.append(values)


class Believer(Probe):
    """One that is told what really is, as well."""

    sections = ("gravimeter", "matcher", "truth")


@pytest.fixture(scope="module")
def context():
    with claim_domain() as domain, local_context(domain) as context:
        yield context


@pytest.fixture
def probe(context):
    nodes = []

    def make(**values):
        named = {key.replace("__", "."): value for key, value in values.items()}
        nodes.append(Probe("probe", values=named, context=context))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


def test_defaults_and_overrides(probe) -> None:
    node = probe(matcher__batch_length=12, gravimeter__sigma=2e-5)
    assert node.scenario.matcher.batch_length == 12
    assert node.scenario.gravimeter.sigma == 2e-5
    assert node.get_parameter("gravimeter.interval").value == 10.0
    assert not node.has_parameter("route.speed")


def test_an_int_is_taken_for_a_double(probe) -> None:
    node = probe(gravimeter__interval=20, matcher__map_sigma=0)
    assert node.get_parameter("gravimeter.interval").value == 20.0
    assert node.set_parameters([Parameter("matcher.bias_sigma", value=1)])[0].successful
    assert node.get_parameter("matcher.bias_sigma").value == 1.0


def test_a_number_or_a_word(probe) -> None:
    assert probe(matcher__map_sigma="auto").scenario.matcher.map_sigma == "auto"


@pytest.mark.parametrize(
    ("value", "sigma"),
    [
        ("", None),
        ("50ug", (4.903325e-4,) * 3),
        (2e-6, (2e-6,) * 3),
        (2, (2.0,) * 3),
        ([1e-6, 2e-6, 3e-6], (1e-6, 2e-6, 3e-6)),
        (["1ug", "2ug", "2e-6"], (9.80665e-6, 1.96133e-5, 2e-6)),
    ],
)
def test_a_quantity_with_or_without_its_unit(probe, value, sigma) -> None:
    found = probe(imu__accelerometer__bias=value).scenario.imu.accelerometer.bias
    assert found == (None if sigma is None else pytest.approx(sigma))


@pytest.mark.parametrize(
    "values",
    [
        {"truth": "{gravimeter: {sigma: 3x}, initial_error: {hidden_position: 3x}}"},
        {"truth.gravimeter.sigma": "3x", "truth.initial_error.hidden_position": "3x"},
    ],
    ids=["YAML", "nested keys"],
)
def test_what_truth_says_of_other_nodes_sections_is_left_to_them(context, values) -> None:
    node = Believer("probe", values=values, context=context)
    assert node.scenario.truth == {"gravimeter": {"sigma": "3x"}}
    assert node.scenario.true.gravimeter.sigma == pytest.approx(3e-5)
    assert "sigma: 3x" in node.get_parameter("truth").value
    node.destroy_node()


def test_keys_inside_a_parameter_of_yaml(probe) -> None:
    node = probe(matcher__options__trust=3.0, truth__imu__grade="quantum")
    assert node.scenario.matcher.options == {"trust": 3.0}
    assert not node.has_parameter("truth")


def test_keys_of_other_nodes_are_no_error(probe) -> None:
    assert probe(route__speed=30.0).scenario.route.speed == 22.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"matcher.batch_lenght": 12}, ["unknown parameter 'matcher.batch_lenght'; did you mean"]),
        ({"rate": 1.0}, ["unknown parameter 'rate'"]),
        ({"matcher.batch_length": 1}, ["matcher.batch_length: must be >= 2, <= 1000, not 1"]),
        ({"matcher.batch_length": "many"}, ["matcher.batch_length", "whole number", "'many'"]),
        ({"gravimeter.sigma": -1e-5}, ["gravimeter.sigma: must be > 0, not -1e-05"]),
        ({"gravimeter.sigma": 0.0}, ["gravimeter.sigma: must be greater than 0, not 0.0"]),
        ({"gravimeter.quantity": "weight"}, ["gravimeter.quantity", "'gravity' or 'disturbance'"]),
        ({"matcher.map_sigma": "often"}, ["matcher.map_sigma"]),
        ({"matcher.options": "{a: ["}, ["matcher.options", "YAML"]),
        ({"matcher.stride": 40}, ["stride (40) must not exceed batch_length (30)"]),
        ({"truth.imu.grade": 3, "truth": ""}, ["unknown parameter 'truth.imu.grade'"]),
        ({"recorders": -1}, ["recorders: must be >= 0"]),
    ],
)
def test_bad_parameters_are_one_clear_line(context, values, words) -> None:
    with pytest.raises(InputError) as error:
        Probe("probe", values=values, context=context)
    message = str(error.value)
    assert "\n" not in message
    for word in ["probe", *words]:
        assert word in message


def test_changes_at_run_time(probe) -> None:
    node = probe()
    refused = node.set_parameters([Parameter("matcher.batch_length", value=10)])[0]
    assert not refused.successful
    assert node.set_parameters([Parameter("matcher.map_sigma", value="auto")])[0].successful
    assert node.seen == [{"matcher.map_sigma": "auto"}]
    refused = node.set_parameters([Parameter("matcher.bias_sigma", value=2.0)])[0]
    assert not refused.successful
    assert refused.reason == "a bias of more than 1 m/s² is no gravimeter's"
    assert node.get_parameter("matcher.bias_sigma").value == 0.0
