"""The joint bound of several fields."""

from dataclasses import replace
from typing import Any

import numpy as np

from helpers.route_maps import field, waves
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.maps.several import FieldMaps
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

GRAVITY_MAP = field(waves)
MAGNETIC_MAP = replace(
    field(lambda n, e: 1e6 * (waves(e, n) - 9.8)), unit="nT", quantity="magnetic_anomaly"
)
GRAVITY: dict[str, Any] = {"field": "gravity", "map_error": {"sigma": 1e-5}}
MAGNETIC: dict[str, Any] = {"field": "magnetic", "sigma": 10.0, "map_error": {"sigma": 10.0}}
MAPS = {"gravity": GRAVITY_MAP, "magnetic": MAGNETIC_MAP}
BASE = {"route": {"duration": 1800.0}, "gravity": {"field": "normal"}}


def bound(*fields, maps=(), **keys):
    scenario = validate_scenario(BASE | {"fields": list(fields)} | keys)
    maps = maps or tuple(MAPS[one["field"]] for one in fields)
    return posterior_cramer_rao(scenario.true, build_trajectory(scenario), FieldMaps(maps))


def test_two_are_better_than_each_and_in_any_order():
    both, turned = bound(GRAVITY, MAGNETIC), bound(MAGNETIC, GRAVITY)
    np.testing.assert_allclose(both.covariance, turned.covariance, rtol=1e-7)
    for one in (bound(GRAVITY), bound(MAGNETIC)):
        apart = one.covariance[-1] - both.covariance[-1]
        assert np.linalg.eigvalsh(apart)[0] > 0.0


def test_two_instruments_on_one_exact_map_are_one_with_half_the_variance():
    exact = {"field": "gravity", "sigma": 2e-5}
    half = {"field": "gravity", "sigma": 2e-5 / np.sqrt(2.0)}
    two = bound(exact, exact | {"name": "other"}, maps=(GRAVITY_MAP, GRAVITY_MAP))
    np.testing.assert_allclose(two.covariance, bound(half).covariance, rtol=1e-9)


def test_each_field_counts_at_its_own_scans():
    """A field of half the rate is one whose every other reading is missing."""
    slow = bound(GRAVITY, MAGNETIC | {"interval": 20.0})
    twice = bound(GRAVITY | {"interval": 20.0}, MAGNETIC | {"interval": 20.0})
    fast = bound(GRAVITY, MAGNETIC)
    assert (twice.rms[-1] > slow.rms_at(twice.time[-1:])[0] > fast.rms[-1]).all()
    assert len(slow.time) == len(fast.time) == 2 * len(twice.time) - 1
