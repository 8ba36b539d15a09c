"""A ROS domain for one graph."""

import socket

import pytest

from isogal.errors import InputError
from isogal_ros.graph.domain import DOMAIN, claim_domain


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
