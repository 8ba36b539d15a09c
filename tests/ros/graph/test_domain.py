"""A ROS domain for one graph."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import rclpy
from rclpy.node import Node

from helpers.domains import claim_domain
from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.domain import DOMAIN, defaults, graph_domain
from isogal_ros.graph.domain import local_context as in_domain


@pytest.fixture
def other_domain(monkeypatch) -> Iterator[int]:
    """A domain of its own for a test, which is the user's."""
    monkeypatch.delenv(DOMAIN)
    with claim_domain() as number:
        monkeypatch.setenv(DOMAIN, str(number))
        yield number


@contextmanager
def node_in(domain: int) -> Iterator[Node]:
    with in_domain(domain) as context:
        node = rclpy.create_node("other", context=context)
        yield node
        node.destroy_node()


def test_a_domain_that_is_claimed_or_has_a_participant_is_not_free(monkeypatch) -> None:
    monkeypatch.delenv(DOMAIN)
    with graph_domain(Scenario()) as first, graph_domain(Scenario()) as second:
        assert first != second
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("", 7410 + 250 * first))
        with graph_domain(Scenario()) as other:
            assert other != first


def test_the_graph_gets_what_the_user_does_not_say() -> None:
    found = defaults({})
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert found["FASTRTPS_DEFAULT_PROFILES_FILE"].endswith("fastdds.xml")
    assert found["RMW_FASTRTPS_USE_QOS_FROM_XML"] == "1"
    assert defaults(found) == {}
    said = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "RMW_FASTRTPS_USE_QOS_FROM_XML": "0"}
    assert list(defaults(said)) == ["FASTRTPS_DEFAULT_PROFILES_FILE"]
    # a user's own profiles mean what they mean elsewhere
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
        assert list(defaults({name: "/my/profiles.xml"})) == ["ROS_AUTOMATIC_DISCOVERY_RANGE"]


def test_a_graph_takes_the_users_domain_where_nobody_publishes_its_topics(
    other_domain, capsys
) -> None:
    """Listeners, and viewers, which offer to publish initialpose, are welcome."""
    with graph_domain(Scenario()) as domain:
        assert domain == other_domain
    with node_in(other_domain) as node:
        node.create_subscription(topics.IMU.type, topics.IMU.name, print, 10)
        node.create_publisher(topics.INITIAL_POSE.type, topics.INITIAL_POSE.name, 10)
        with graph_domain(Scenario()) as domain:
            assert domain == other_domain
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("topic", [topics.IMU, topics.CLOCK])
def test_a_graph_does_not_join_publishers_of_its_topics(other_domain, capsys, topic) -> None:
    with node_in(other_domain) as node:
        node.create_publisher(topic.type, topic.name, 10)
        with graph_domain(Scenario()) as domain:
            assert domain != other_domain
        (line,) = capsys.readouterr().err.splitlines()
        assert line == (
            f"isogal: {DOMAIN}={other_domain}: another node in it publishes {topic.name}; taking"
            f" domain {domain} instead"
        )
        said = rf"^--domain {other_domain}: another node in it publishes {topic.name}; end it"
        with pytest.raises(InputError, match=said), graph_domain(Scenario(), other_domain):
            pass


def test_two_graphs_that_start_at_once_are_kept_apart(other_domain, capsys) -> None:
    """When neither has a publisher yet."""
    with graph_domain(Scenario()) as first, graph_domain(Scenario()) as second:
        assert first == other_domain != second
        assert "another isogal run is in it" in capsys.readouterr().err
        with (
            pytest.raises(InputError, match="another isogal run"),
            graph_domain(Scenario(), first),
        ):
            pass
    with graph_domain(Scenario(), other_domain) as again:
        assert again == other_domain
