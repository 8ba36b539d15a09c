"""A gradiometer's tilted platform and drifting components."""

from dataclasses import replace

import numpy as np
import pytest

from isogal.earth.gravity import normal_gradient
from isogal.errors import InputError
from isogal.matching.batching import BatchBuilder
from isogal.scenario import TENSOR_COMPONENTS, Gradiometer, Gravimeter, load_scenario
from isogal.sensors.gradiometer_errors import EOTVOS, noise_of, tilt_effect, tilt_errors, tilted
from isogal.sensors.noise import RunScans
from isogal.sensors.trajectory import build_trajectory

LATITUDE = -0.64
ROUTE = build_trajectory(load_scenario(None, ["route.duration=1200"]))
INDEX = np.arange(10, 1201, 10)
PRIOR = np.diag([1e4, 1e4, 1.0, 1.0, 1e-8, 1e-8, 1e-8])


def errors(run=0, felt=None, **settings):
    told = Gradiometer(**settings)
    felt = np.zeros((len(INDEX), len(told.components))) if felt is None else felt
    slow = replace(noise_of(told, Gravimeter()), white=0.0)
    noise = slow.draw(1, run, ROUTE.time[INDEX], felt.shape[1:])
    return noise + tilt_errors(told, RunScans(1, run, ROUTE, INDEX), felt)


def test_a_turned_tensor_has_the_same_invariants():
    random = np.random.default_rng(0)
    tensor = random.standard_normal((4, 3, 3))
    tensor = tensor + tensor.swapaxes(1, 2)
    found = tilted(tensor, random.standard_normal((4, 3)))
    np.testing.assert_allclose(np.linalg.eigvalsh(found), np.linalg.eigvalsh(tensor), rtol=1e-9)
    # a quarter turn about down: the new north is the old east, the new east the old south
    quarter = tilted(tensor, np.array([0.0, 0.0, 0.5 * np.pi]))
    np.testing.assert_allclose(quarter[:, 0, 0], tensor[:, 1, 1], atol=1e-12)
    np.testing.assert_allclose(quarter[:, 0, 1], -tensor[:, 0, 1], atol=1e-12)
    np.testing.assert_allclose(quarter[:, 0, 2], tensor[:, 1, 2], atol=1e-12)


def test_the_effect_is_the_derivative_of_the_turned_normal_gradient():
    rows, columns = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
    normal, effect = normal_gradient(LATITUDE), tilt_effect(TENSOR_COMPONENTS, LATITUDE)
    for axis in range(2):
        turn = np.zeros(3)
        turn[axis] = 1e-5
        change = (tilted(normal, turn) - tilted(normal, -turn))[rows, columns] / 2e-5
        np.testing.assert_allclose(effect[:, axis], change, atol=1e-5 * EOTVOS)
    # 1e-4 rad: 0.46 E in nd and in ed, and hardly anything in others
    assert abs(effect[2, 1]) == pytest.approx(4627.0 * EOTVOS, rel=1e-3)
    assert abs(effect[4, 0]) == pytest.approx(4620.0 * EOTVOS, rel=1e-3)
    assert np.abs(np.delete(effect.ravel(), [2 * 2 + 1, 4 * 2])).max() < 20.0 * EOTVOS


def test_simulated_tilt_is_a_process_of_its_time():
    """300 runs: 1-sigmas within 5 % and a correlation within 0.1 are exceeded once in 1,000."""
    normal = normal_gradient(ROUTE.latitude[INDEX], ROUTE.height[INDEX])
    felt = normal[:, [0, 1], [2, 2]] + 20.0 * EOTVOS
    keys = {"components": ("nd", "ed"), "platform_tilt": 1e-4, "platform_time": 300.0}
    found = np.stack([errors(run, felt, **keys) for run in range(300)]) / EOTVOS
    np.testing.assert_allclose(found.std(axis=0).mean(axis=0), [0.4627, 0.462], rtol=0.05)
    later = (found[:, 30] * found[:, 0]).mean(axis=0) / (found[:, 0] ** 2).mean(axis=0)
    np.testing.assert_allclose(later, np.exp(-1.0), atol=0.25)
    np.testing.assert_array_equal(found[7], errors(7, felt, **keys) / EOTVOS)


def test_what_is_not_measured_follows_by_the_trace_or_is_the_normal_gradient():
    normal = normal_gradient(ROUTE.latitude[INDEX], ROUTE.height[INDEX])
    field = 100.0 * EOTVOS * np.diag([1.0, 2.0, -3.0])
    whole = errors(
        felt=(normal + field)[:, [0, 0, 1, 1], [0, 2, 1, 2]],
        components=("nn", "nd", "ee", "ed"), platform_tilt=1e-3,
    )  # fmt: skip
    part = errors(
        felt=(normal + field)[:, [0, 1], [2, 2]], components=("nd", "ed"), platform_tilt=1e-3
    )
    # 4627 E more by 400 and 500 E of the field's own where its diagonal is known
    ratio = whole[:, [1, 3]] / part
    np.testing.assert_allclose(
        np.median(ratio, axis=0), [1 - 400 / 4627, 1 - 500 / 4620], rtol=3e-3
    )


def test_offsets_and_their_walk():
    plain = errors(bias_eotvos=2.0)
    assert np.ptp(plain, axis=0).max() == 0.0 and len(np.unique(plain[0])) == 5
    both = np.stack([errors(run, bias_eotvos=2.0, bias_walk_eotvos=0.1) for run in range(200)])
    spread = (both / EOTVOS).std(axis=(0, 2))
    # of 1000 numbers, within 10 %: once in 100,000
    np.testing.assert_allclose(spread, np.sqrt(4.0 + 0.01 * ROUTE.time[INDEX]), rtol=0.1)
    assert not errors().any()


def parameters(components, *more):
    """Those of a batch of three scans."""
    told = f"gradiometer.components=[{components}]", "matcher.batch_length=3"
    builder = BatchBuilder.of(load_scenario(None, ["field=gradient", *told, *more]))
    count = components.count(",") + 1
    for k in range(3):
        readings = np.ones(count) if count > 1 else 1.0
        builder.add_scan(10.0 * k, LATITUDE, 2.5, np.array([0.0, 20.0]), readings, 1.0)
    return builder.build(PRIOR).instrument.parameters


def test_a_tilt_is_allowed_for_where_nobody_has_told_of_one():
    """But not of one component, where it is an offset, nor by matchers that estimate nothing."""
    allowed = parameters("nd, ne")
    np.testing.assert_allclose(allowed.sigma, [5e-3, 5e-3])
    np.testing.assert_array_equal(allowed.time, [3600.0, 3600.0])
    beside = parameters("nd, ne", "gradiometer.bias_eotvos=3", "gradiometer.allowed_tilt=1e-3")
    np.testing.assert_allclose(beside.sigma, [1e-3, 1e-3, 3e-9, 3e-9])
    assert parameters("nd") is None
    for without in ("matcher.name=iccp", "gradiometer.allowed_tilt=0"):
        assert parameters("nd, ne", without) is None


def test_a_batch_has_what_is_told_as_parameters():
    told = parameters(
        "nd, ne", "gradiometer.platform_tilt=1e-4", "gradiometer.bias_walk_eotvos=0.02"
    )
    assert told.names == ("tilt_north", "tilt_east", "bias_nd", "bias_ne")
    np.testing.assert_allclose(told.sigma, [1e-4, 1e-4, 0.0, 0.0])
    np.testing.assert_allclose(told.walk, [0.0, 0.0, 2e-11, 2e-11])
    np.testing.assert_array_equal(told.time, [3600.0, 3600.0, np.inf, np.inf])
    effect = tilt_effect(("nd", "ne"), LATITUDE)
    np.testing.assert_allclose(told.reading[:2], np.column_stack([effect, np.eye(2)]))
    np.testing.assert_allclose(told.reading[4:], told.reading[:2])
    with pytest.raises(InputError, match=r"platform_tilt"):
        parameters("nd, ne", "gradiometer.platform_tilt=0.2")
