"""Samples one by one: steps at multiples of their duration, jitter, gaps, a rate that is not as
told."""

from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from isogal.fusion.sample_stream import SECOND, TOGETHER, SampleStream
from isogal.inertial.preintegration import preintegrate


def motion(t):
    """Specific force and angular rate of a smooth motion."""
    force = np.array([0.5 * np.sin(t), 0.3 * np.cos(0.7 * t), -9.8 + 0.1 * np.sin(0.3 * t)])
    return force, np.array([0.01 * np.cos(t), 0.02 * np.sin(0.5 * t), 0.05 * np.sin(0.2 * t)])


def feed(stream, stamps, begin=0):
    """Take samples of the motion at stamps (s), each at the middle of its interval."""
    stream.begin(round(begin * SECOND))
    steps, last = [], begin
    for stamp in stamps:
        steps += stream.take(round(stamp * SECOND), *motion(0.5 * (stamp + last)))
        last = stamp
    return steps


def attitude_of(steps, begin=0):
    """Sum of turns and velocity increments: of a slow motion nearly the integrals."""
    total, last = np.zeros(6), round(begin * SECOND)
    for step in steps:
        total += np.concatenate([step.force, step.rate]) * (step.ns - last) / SECOND
        last = step.ns
    return total


def test_regular_samples_are_those_of_the_library():
    stamps = np.arange(1, 1001) / 200.0
    steps = feed(SampleStream(200.0, 200), stamps)
    assert [step.ns for step in steps] == [SECOND * k for k in range(1, 6)]
    samples = np.array([np.concatenate(motion(t - 0.0025)) for t in stamps])[None]
    lengths, ends = np.full(1000, 0.005), np.arange(0, 1001, 200)
    force, rate = preintegrate(samples[..., :3], samples[..., 3:], lengths, ends)
    np.testing.assert_allclose([step.force for step in steps], force[0], rtol=1e-12)
    np.testing.assert_allclose([step.rate for step in steps], rate[0], rtol=1e-12)
    assert not any(step.missing for step in steps)


@pytest.mark.parametrize(
    ("rate", "size", "stamps", "begin", "ends"),
    [
        (119.0, 17, np.round(np.arange(1, 1191) / 119.0, 9), 0.0, np.arange(1, 71) / 7),
        (100.0, 100, 17.3 + np.arange(1, 201) / 100.0, 17.3, [18.0, 19.0]),
        (20.0, 2, np.arange(1, 41) * 0.25, 0.0, np.arange(1, 101) / 10),
    ],
    ids=["not whole nanoseconds", "a start between ends", "samples slower than steps"],
)
def test_ends_of_steps(rate, size, stamps, begin, ends):
    steps = feed(SampleStream(rate, size), stamps, begin)
    assert [step.ns for step in steps] == [round(SECOND * end) for end in ends]


@cache
def smooth():
    """Steps of 5 s of regular samples."""
    return feed(SampleStream(200.0, 200), np.arange(1, 1001) / 200.0)


@settings(max_examples=15)
@example(153)  # the median of its first sixteen intervals is 11 % too short
@given(st.integers(0, 1000))
def test_jitter_does_not_move_the_ends_of_steps(seed):
    random = np.random.default_rng(seed)
    stamps = np.arange(1, 1001) / 200.0 + random.uniform(-0.001, 0.001, 1000)
    stream = SampleStream(200.0, 200)
    steps = feed(stream, stamps)
    ends = np.array([step.ns for step in steps])
    assert np.abs(ends - SECOND * np.arange(1, len(steps) + 1)).max() <= TOGETHER
    assert len(steps) >= 4
    assert stream.missing == 0 and stream.as_told
    for one, other in zip(steps, smooth(), strict=False):
        np.testing.assert_allclose(one.force, other.force, atol=2e-3)
        np.testing.assert_allclose(one.rate, other.rate, atol=1e-4)


def test_a_short_gap_is_filled_in_and_counted():
    stamps = np.delete(np.arange(1, 601) / 200.0, np.r_[50, 300:310])
    stream = SampleStream(200.0, 200)
    steps = []
    stream.begin(0)
    for stamp in stamps:  # each sample covers its own interval only
        steps += stream.take(round(stamp * SECOND), *motion(stamp - 0.0025))
    whole = feed(SampleStream(200.0, 200), np.arange(1, 601) / 200.0)
    assert [step.ns for step in steps] == [step.ns for step in whole]
    assert stream.missing == 11
    for one, other in zip(steps, whole, strict=True):
        np.testing.assert_allclose(one.force, other.force, atol=2e-5)
        np.testing.assert_allclose(one.rate, other.rate, atol=2e-6)
    assert [step.missing > 0.0 for step in steps] == [True, True, False]
    # ten samples in a row leave more unknown than one, but far less than had nothing been known
    assert steps[0].missing < steps[1].missing < 0.1 * 0.05


def test_a_long_gap_is_not_filled_in():
    stamps = np.concatenate([np.arange(1, 251) / 200.0, 30.0 + np.arange(0, 201) / 200.0])
    stream = SampleStream(200.0, 200)
    steps = feed(stream, stamps[:250])
    steps += stream.take(30 * SECOND, *motion(30.0))
    # the step that had begun ends with the last sample
    assert [step.ns / SECOND for step in steps] == [1.0, 1.25, 30.0]
    assert steps[-1].missing == pytest.approx(28.75 - 0.005)
    more = []
    for stamp in stamps[251:]:
        more += stream.take(round(stamp * SECOND), *motion(stamp))
    assert [step.ns / SECOND for step in more] == [31.0]
    assert more[0].missing == 0.0
    assert stream.missing == 5749


@pytest.mark.parametrize("real", [50.0, 400.0])
def test_a_rate_that_is_not_as_told_does_no_harm(real):
    stream = SampleStream(200.0, 200)
    steps = feed(stream, np.arange(1, round(5 * real) + 1) / real)
    assert [step.ns for step in steps] == [SECOND * k for k in range(1, 6)]
    assert not stream.as_told
    assert stream.measured_rate == pytest.approx(real)
    assert stream.missing == 0
    np.testing.assert_allclose(attitude_of(steps), attitude_of(smooth()), atol=2e-3)
    assert max(step.missing for step in steps[1:]) == 0.0
