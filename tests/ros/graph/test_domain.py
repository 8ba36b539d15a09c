"""A ROS domain for one graph."""

import socket

import pytest

from isogal.errors import InputError
from isogal_ros.graph.domain import DOMAIN, claim_domain, defaults


def test_the_users_domain_is_taken(monkeypatch) -> None:
    monkeypatch.setenv(DOMAIN, "77")
    with claim_domain() as domain:
        assert domain == 77


@pytest.mark.parametrize("value", ["-1", "233", "seven"])
def test_no_such_domain(monkeypatch, value) -> None:
    monkeypatch.setenv(DOMAIN, value)
    with (
        pytest.raises(InputError, match="ROS_DOMAIN_ID: must be a number from 0 to 232"),
        claim_domain(),
    ):
        pass


def test_two_graphs_get_two_domains(monkeypatch) -> None:
    monkeypatch.delenv(DOMAIN)
    with claim_domain() as first, claim_domain() as second:
        assert first != second
    with claim_domain() as third:
        assert third == first


def test_a_domain_with_a_participant_is_not_free(monkeypatch) -> None:
    monkeypatch.delenv(DOMAIN)
    with claim_domain() as domain:
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("", 7410 + 250 * domain))
        with claim_domain() as other:
            assert other != domain


def test_the_graph_gets_what_the_user_does_not_say() -> None:
    found = defaults({})
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert found["FASTRTPS_DEFAULT_PROFILES_FILE"].endswith("fastdds.xml")
    assert found["RMW_FASTRTPS_USE_QOS_FROM_XML"] == "1"
    assert defaults(found) == {}
    said = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "RMW_FASTRTPS_USE_QOS_FROM_XML": "0"}
    assert list(defaults(said)) == ["FASTRTPS_DEFAULT_PROFILES_FILE"]


@pytest.mark.parametrize(
    "name", ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"]
)
def test_a_users_own_profiles_mean_what_they_mean_elsewhere(name) -> None:
    assert list(defaults({name: "/my/profiles.xml"})) == ["ROS_AUTOMATIC_DISCOVERY_RANGE"]
