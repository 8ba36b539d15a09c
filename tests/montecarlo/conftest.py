"""Fixtures of the tests of Monte Carlo."""

import pytest

from helpers.studies import Watcher, small_scenario, wavy_map
from isogal.montecarlo.cases import Case


@pytest.fixture(scope="session")
def field_map():
    """The made-up map."""
    return wavy_map()


@pytest.fixture(scope="session")
def small_case(field_map):
    """Four runs."""
    return Case("small", small_scenario(), 4, field_map)


@pytest.fixture
def watcher():
    """A display that remembers."""
    return Watcher()
