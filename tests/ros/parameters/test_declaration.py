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

    def make(values=(), kind=Probe):
        nodes.append(kind("probe", values=dict(values), context=context))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


def test_defaults_overrides_and_keys_of_other_nodes(probe) -> None:
    """Ints are taken for doubles, words beside numbers, keys inside a parameter of YAML."""
    node = probe(
        {
            "gravimeter.interval": 20,
            "matcher.batch_length": 12,
            "matcher.map_sigma": "auto",
            "matcher.options.trust": 3.0,
            "route.speed": 30.0,
            "truth.imu.grade": "quantum",
        }
    )
    matcher = node.scenario.matcher
    assert (matcher.batch_length, matcher.map_sigma) == (12, "auto")
    assert matcher.options == {"trust": 3.0}
    assert node.get_parameter("gravimeter.interval").value == 20.0
    assert node.get_parameter("gravimeter.sigma").value == 1e-5
    assert node.scenario.route.speed == 22.0
    assert not node.has_parameter("route.speed")
    assert not node.has_parameter("truth")


@pytest.mark.parametrize(
    ("value", "sigma"),
    [("", None), (2, (2.0,) * 3), (["1ug", "2ug", "2e-6"], (9.80665e-6, 1.96133e-5, 2e-6))],
)
def test_a_quantity_with_or_without_its_unit(probe, value, sigma) -> None:
    found = probe({"imu.accelerometer.bias": value}).scenario.imu.accelerometer.bias
    assert found == (None if sigma is None else pytest.approx(sigma))


@pytest.mark.parametrize(
    "values",
    [
        {"truth": "{gravimeter: {sigma: 3x}, initial_error: {hidden_position: 3x}}"},
        {"truth.gravimeter.sigma": "3x", "truth.initial_error.hidden_position": "3x"},
    ],
    ids=["YAML", "nested keys"],
)
def test_what_truth_says_of_other_nodes_sections_is_left_to_them(probe, values) -> None:
    node = probe(values, Believer)
    assert node.scenario.truth == {"gravimeter": {"sigma": "3x"}}
    assert node.scenario.true.gravimeter.sigma == pytest.approx(3e-5)
    assert "sigma: 3x" in node.get_parameter("truth").value


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"matcher.batch_lenght": 12}, "unknown parameter 'matcher.batch_lenght'; did you mean"),
        ({"xyzzy": 1.0}, "unknown parameter 'xyzzy'; allowed: "),
        ({"start_time": 1.0}, "(another node's own stand under that node's name in a file"),
        ({"matcher.batch_length": 1}, "matcher.batch_length: must be at least 2, not 1"),
        ({"matcher.batch_length": "many"}, "matcher.batch_length: must be a whole number"),
        ({"gravimeter.sigma": -1e-5}, "gravimeter.sigma: must be greater than 0, not -1e-05"),
        ({"matcher.options": "{a: ["}, "matcher.options: must hold YAML"),
        ({"truth.imu.grade": 3, "truth": ""}, "unknown parameter 'truth.imu.grade'"),
        ({"recorders": -1}, "recorders: must be at least 0"),
    ],
)
def test_bad_parameters_are_one_clear_line(context, values, words) -> None:
    with pytest.raises(InputError) as error:
        Probe("probe", values=values, context=context)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("probe: ")
    assert words in message


def test_changes_at_run_time(probe) -> None:
    node = probe()

    def change(name: str, value: object) -> tuple[bool, str]:
        (result,) = node.set_parameters([Parameter(name, value=value)])
        return result.successful, result.reason

    assert not change("matcher.batch_length", 10)[0]
    assert change("matcher.map_sigma", "auto") == (True, "")
    assert change("matcher.bias_sigma", 1) == (True, "")
    assert node.seen == [{"matcher.map_sigma": "auto"}, {"matcher.bias_sigma": 1.0}]
    said = "a bias of more than 1 m/s² is no gravimeter's"
    assert change("matcher.bias_sigma", 2.0) == (False, said)
    assert node.get_parameter("matcher.bias_sigma").value == 1.0
