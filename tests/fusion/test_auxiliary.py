"""Auxiliary states of the filter: against filterpy with a sigma point for each, and against the
processes that they stand for."""

import dataclasses

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.navigators import SIGMA, assert_close, fly, random_covariance
from isogal.fields.known_gravity import KnownGravity
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial.gravity import compensation_by
from isogal.maps.channels import ChannelMap

# The filter is compiled for each number of states, ten seconds each: eight auxiliary states, as
# with a barometer and a log, and two, as where the map says its error, are compiled anyway.
EVERY_KIND = (
    AuxiliaryState("gravity_north", "gravity", 0, 2e-4, length=8e3),
    AuxiliaryState("gravity_down", "gravity", 2, 3e-4, length=9e3, time=900.0),
    AuxiliaryState("accelerometer_y", "accelerometer", 1, 1e-4, time=300.0),
    AuxiliaryState("gyroscope_x", "gyroscope", 0, 1e-7, time=600.0, walk=1e-10),
    AuxiliaryState("gyroscope_scale_z", "gyroscope_scale", 2, 1e-3),
    AuxiliaryState("barometer_bias", "none", 0, 5.0, walk=0.1),
    AuxiliaryState("gyroscope_misalignment", "gyroscope_scale", 0, 1e-5, source=2),
    AuxiliaryState("accelerometer_misalignment", "accelerometer_scale", 1, 1e-5, source=0),
)
SPARE = AuxiliaryState("spare", "none", 0, 1.0)
"""Does nothing."""
MAP = field_map_of(wavy)


def with_states(states, filter_name="compiled") -> FilterModel:
    plain = fly().model
    return dataclasses.replace(plain, auxiliary=tuple(states), filter=filter_name)


def start(model: FilterModel, seed: int = 3) -> FilterState:
    """A start with a full covariance, and auxiliary states that are not zero."""
    plain = fly().start
    sigma = np.array([*SIGMA, *(state.sigma for state in model.auxiliary)])
    means = sigma[15:] * np.random.default_rng(seed).standard_normal(len(sigma) - 15)
    return dataclasses.replace(plain, auxiliary=means, covariance=random_covariance(sigma, seed))


OF_A_MAP = KnownGravity(
    compensation_by(ChannelMap((MAP, field_map_of(lambda north, east: wavy(-east, north)))), 1.0)
)
"""Of which the compiled filter does within an interval what is linear in the place."""


@pytest.mark.parametrize(
    ("count", "gravity"), [(2, KnownGravity()), (8, KnownGravity()), (2, OF_A_MAP)]
)
def test_every_kind_equals_a_filter_with_sigma_points_for_all_states(count, gravity):
    flight = fly()
    force, rate, height = flight.samples(0, 20)
    force = force + np.array([0.5, 0.0, 0.0])  # scale factors have something to act on
    rate = rate + np.array([0.0, 0.0, 0.01])
    ends = []
    for name in ("compiled", "reference"):
        model = dataclasses.replace(with_states(EVERY_KIND[:count], name), gravity=gravity)
        state = start(model)
        propagate(state, model, force, rate, height)
        ends.append(state)
    assert not np.array_equal(ends[0].position, ends[1].position)  # two filters, not one
    # the columns of auxiliary states leave out what a turning body does within a second
    assert_close(*ends, 1.2e-4, 1.2e-4)


@pytest.mark.parametrize("filter_name", ["compiled", "reference"])
def test_gravity_states_go_by_what_has_been_learnt(filter_name):
    """A navigator whose residual gravity was learnt propagates as under a model that knows it; one
    of which nothing was learnt as under its own."""
    assumed = (AuxiliaryState("gravity_north", "gravity", 0, 2e-5, length=4e3), SPARE)
    true = (AuxiliaryState("gravity_north", "gravity", 0, 2e-4, length=9e3), SPARE)
    flight, ends = fly(), []
    for states, residual in ((assumed, (2e-4, 9e3)), (true, (0.0, 0.0)), (assumed, (0.0, 0.0))):
        state = start(with_states(assumed))
        state.residual_gravity[:] = residual
        propagate(state, with_states(states, filter_name), *flight.samples(0, 20))
        ends.append(state)
    learnt, known, plain = ends
    assert known.covariance[15, 15] > 1.5 * plain.covariance[15, 15]
    np.testing.assert_array_equal(learnt.covariance, known.covariance)
    np.testing.assert_array_equal(learnt.position, known.position)
