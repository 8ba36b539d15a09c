"""Horizontal gravity that nothing takes off, within a batch."""

from dataclasses import replace

import numpy as np
import pytest

from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import Fix
from isogal.matching.joint_batches import JointBatches
from isogal.matching.residual_gravity import ResidualGravity
from isogal.matching.scans import Collected
from isogal.scenario import Matcher
from isogal.sensors.gravimeter import GravityReduction

SIGMA, SPEED, SPAN = 2e-4, 22.0, 600.0
TIMES = np.arange(0.0, SPAN + 1.0, 20.0)
VELOCITY = np.tile([0.6 * SPEED, 0.8 * SPEED], (len(TIMES), 1))
PRIOR = np.diag([30.0, 30.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4]) ** 2


@pytest.mark.parametrize("length", [6_000.0, 20_000.0, 1e9])
def test_covariance_is_that_of_the_process_integrated(length: float) -> None:
    apart = ResidualGravity(SIGMA, length).apart(VELOCITY, TIMES, SPAN, PRIOR)
    fine = np.linspace(0.0, SPAN, 1201)
    step = fine[1]
    process = SIGMA**2 * np.exp(-np.abs(fine[:, None] - fine) * SPEED / length)
    weight = np.full(len(fine), step)
    weight[[0, -1]] = step / 2.0
    later = np.maximum(fine - TIMES[:, None], 0.0)
    moves = np.concatenate([later * weight, -np.sign(later) * weight])  # position, velocity
    expected = moves @ process @ moves.T
    scale = np.sqrt(np.diag(expected).reshape(2, -1).max(axis=1)).repeat(len(TIMES))
    for axis in range(2):
        root = np.concatenate([apart[:, axis], apart[:, 2 + axis]])
        np.testing.assert_allclose(
            root @ root.T / scale / scale[:, None], expected / scale / scale[:, None], atol=0.02
        )
    assert not (apart[:, 0] * apart[:, 1]).any()
    assert not apart[:, 4:].any()
    assert not apart[-1].any()


def test_what_is_too_small_to_matter_is_left_out() -> None:
    assert ResidualGravity(1e-5, 1e4).apart(VELOCITY, TIMES, SPAN, PRIOR).shape == (31, 7, 0)
    assert ResidualGravity(1e-5, 1e4).apart(VELOCITY, TIMES, SPAN, PRIOR / 100.0).shape[2] > 0
    assert ResidualGravity().apart(VELOCITY, TIMES, SPAN, PRIOR / 1e9).shape == (31, 7, 0)


def build(sigma: float):
    builder = BatchBuilder(Matcher(batch_length=20, stride=10), GravityReduction(), context=10)
    builder.gravity = ResidualGravity(sigma, 20_000.0)
    for k, (time, velocity) in enumerate(zip(TIMES, VELOCITY, strict=True)):
        builder.add_scan(time, -0.6, 2.4 + 1e-7 * time, velocity, 0.0, 1e-5)
        if k == 20:
            builder.build(PRIOR)
    return builder.build(PRIOR)


def test_a_batch_has_it_beside_the_attitude() -> None:
    without, batch = build(0.0), build(SIGMA)
    assert without.nuisance.shape[2] == 3
    count = batch.nuisance.shape[2]
    assert count > 3
    np.testing.assert_array_equal(batch.nuisance[..., :3], without.nuisance)
    # the first scan is 580 s before the end: half of that squared, 34 m, a little less for the
    # process does not stay as it is
    moved = np.sqrt((batch.nuisance[0, :2, 3:] ** 2).sum(axis=1))
    np.testing.assert_allclose(moved, 0.5 * SIGMA * 580.0**2, rtol=0.15)


def test_batches_go_by_the_map_error_that_a_fix_tells() -> None:
    def fresh() -> JointBatches:
        builder = BatchBuilder(Matcher(batch_length=20, stride=10), GravityReduction())
        return JointBatches([builder], gravity=known)

    known = KnownGravity(residual=Residual(0.0, 1.0), map_sigma=2e-5)
    batches = fresh()
    first = batches.builders[0].gravity
    assert first == ResidualGravity.of(known)
    fix = Fix(0.0, 0.0, 0.0, np.eye(2))
    batches.learn(fix)
    assert batches.builders[0].gravity == first
    batches.learn(replace(fix, map_error=(8e-5, 3e3)))
    learnt = batches.builders[0].gravity
    assert learnt == ResidualGravity(pytest.approx(np.hypot(8e-5 / np.sqrt(2.0), 1e-6)), 3e3)
    again = fresh()
    again.restore(batches.collected)  # a checkpoint keeps it
    assert again.builders[0].gravity == learnt
    again.restore([Collected((), 0, 0)])  # a new beginning forgets it
    assert again.builders[0].gravity == first
