"""Isogal's filter against filterpy's, which the scenario key fusion.filter chooses."""

import numpy as np

from helpers.batches import field_map_of, wavy
from helpers.navigators import ROUTE
from isogal.montecarlo.engine import simulate
from isogal.scenario import Fusion, Gravimeter, InitialError, MapError, Matcher, Scenario


def several_minutes(which: str) -> Scenario:
    return Scenario(
        gravity={"field": "map"},
        route=ROUTE.model_copy(update={"duration": 450.0, "speed": 22.0}),
        initial_error=InitialError(position=300.0),
        gravimeter=Gravimeter(quantity="disturbance"),
        map_error=MapError(sigma=1e-5),
        matcher=Matcher(batch_length=15, stride=5, map_sigma=1e-5),
        fusion=Fusion(filter=which),
    )


def test_an_aided_flight():
    """With gravity of the map, whose auxiliary states do within an interval what is linear in the
    compiled filter."""
    tolerance = 1e-3
    field_map = field_map_of(wavy, half=60e3, step=500.0)
    compiled, by_filterpy = (
        simulate(several_minutes(w), [0], field_map) for w in ("compiled", "reference")
    )
    assert compiled.published.sum() > 4
    assert np.abs(compiled.error - compiled.unaided_error).max() > 100.0
    np.testing.assert_array_equal(by_filterpy.published, compiled.published)
    np.testing.assert_allclose(by_filterpy.error, compiled.error, rtol=0.0, atol=tolerance)
    # in a direction of which a fix says next to nothing it is tens of kilometres off
    np.testing.assert_allclose(
        by_filterpy.fix_error, compiled.fix_error, rtol=1e-7, atol=tolerance
    )
    sigma, expected = (
        np.sqrt(np.diagonal(runs.covariance, axis1=-2, axis2=-1))
        for runs in (by_filterpy, compiled)
    )
    np.testing.assert_allclose(sigma, expected, rtol=0.0, atol=tolerance)
    assert not np.array_equal(by_filterpy.error, compiled.error)  # two filters, not one
