"""Batches of the gravity gradient tensor whose map errors come from one potential."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch, wavy
from isogal.maps.potential import derivatives
from isogal.matching.batching import BatchBuilder
from isogal.matching.expansion import channel_batch, first_channel
from isogal.scenario import load_scenario

EOTVOS = 1e-9
COMPONENTS = ("nn", "nd", "ed", "dd")
DISTURBANCE = field_map_of(wavy, half=40e3)
MAPS = derivatives(DISTURBANCE, COMPONENTS, edge=15e3)
SCANS, C = 12, len(COMPONENTS)


def batch_of(readings=None):
    scalar, _ = make_batch(DISTURBANCE, np.zeros(4), SCANS)
    if readings is None:
        readings = MAPS.value(scalar.latitude, scalar.longitude)
    batch = channel_batch(scalar, readings, EOTVOS**2 * np.eye(C))
    return replace(batch, layout=replace(batch.layout, of_one_potential=COMPONENTS))


def test_a_scenario_says_it():
    settings = load_scenario(
        None,
        [
            "field=gradient",
            "gradiometer.map_errors=one_potential",
            "gradiometer.components=[nd, ed]",
            "matcher.batch_length=3",
        ],
    )
    builder = BatchBuilder.of(settings)
    for k in range(3):
        builder.add_scan(10.0 * k, -0.6, 2.5 + 1e-5 * k, np.array([0.0, 20.0]), np.ones(2), 1.0)
    batch = builder.build(np.diag([1e4, 1e4, 1.0, 1.0, 1e-8, 1e-8, 1e-8]))
    assert batch.layout.of_one_potential == ("nd", "ed")
    assert len(batch) == 6
    first, _ = first_channel(batch_of(), MAPS)
    assert first.layout is None and len(first) == SCANS


def test_truth_can_differ():
    settings = load_scenario(
        None, ["field=gradient", "truth.gradiometer.map_errors=one_potential"]
    )
    assert settings.gradiometer.of_one_potential is None
    assert settings.true.gradiometer.of_one_potential == ("nn", "ne", "nd", "ee", "ed")
    with pytest.raises(Exception, match=r"map_errors.*one_potential"):
        load_scenario(None, ["field=gradient", "gradiometer.map_errors=often"])
