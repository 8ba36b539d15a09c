"""The gradiometer: normal gradient, reduction, noise with covariance, a tilted platform, drifting
components, and what a scenario may say of it."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.refusals import refusal
from helpers.statistics import within_chi_square
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.gravity import normal_gradient, normal_gravity
from isogal.fields.gradient import GRADIENT
from isogal.fields.measured import reading_sigma
from isogal.fields.simulator import ReadingSimulator
from isogal.maps.potential import derivatives
from isogal.matching.batching import BatchBuilder
from isogal.scenario import (
    TENSOR_COMPONENTS,
    Gradiometer,
    Gravimeter,
    Route,
    Scenario,
    load_scenario,
)
from isogal.sensors.gradiometer import (
    EOTVOS,
    GradientReduction,
    noise_covariance,
    noise_of,
    tilt_effect,
    tilt_errors,
    tilted,
)
from isogal.sensors.noise import RunScans
from isogal.sensors.reduction import State, reduction_variance
from isogal.sensors.trajectory import build_trajectory

COVARIANCE = ((4.0, 1.0), (1.0, 9.0))
TENSOR = derivatives(field_map_of(wavy, half=50e3, step=500.0), ("nd", "ee"), height=100.0)


def scenario(*more):
    return load_scenario(None, ["field=gradient", *more])


def vehicle(**gradiometer):
    route = Route(start=tuple(np.degrees(ORIGIN)), end=(-36.4, 147.2), duration=600.0)
    return Scenario(
        field="gradient", route=route, gradiometer={"components": ("nd", "ee")} | gradiometer
    )


def draw_noise(it, run, scans):
    count = len(it.gradiometer.components)
    return noise_of(it.gradiometer, it.gravimeter).draw(it.seed, run, np.arange(scans), (count,))


@pytest.mark.parametrize("degrees", [-80.0, 0.0, 10.0])
def test_normal_gradient_is_the_derivative_of_normal_gravity(degrees):
    latitude = np.radians(degrees)
    gradient = normal_gradient(latitude, 500.0)
    down = (normal_gravity(latitude, 490.0) - normal_gravity(latitude, 510.0)) / 20.0
    assert gradient[2, 2] == pytest.approx(down, rel=5e-5)
    assert np.trace(gradient) == pytest.approx(2.0 * EARTH_RATE**2, rel=1e-9)
    north = (normal_gravity(latitude + 1e-5) - normal_gravity(latitude - 1e-5)) / 2e-5 / 6.37e6
    assert gradient[0, 2] == pytest.approx(north, rel=1e-2, abs=1e-12)
    np.testing.assert_array_equal(gradient, gradient.T)


def test_reduction_is_the_inverse_of_the_measurement():
    reduction = GradientReduction()
    at = State(np.full(3, -0.65), 2.5, 200.0, 15.0, 15.0)
    value = 50.0 * EOTVOS * np.arange(18.0).reshape(3, 6)
    felt = reduction.raw(value, at)
    normal = normal_gradient(-0.65, 200.0)[np.triu_indices(3)]
    np.testing.assert_allclose(felt - value, np.tile(normal, (3, 1)), atol=1e-17)
    np.testing.assert_allclose(reduction.reduce(felt, at), value, atol=1e-6 * EOTVOS)
    far = State(-0.65 + 1e3 / 6.37e6, 2.5, 205.0, 15.0, 15.0)
    assert np.abs(reduction.reduce(felt, far) - value).max() < 0.01 * EOTVOS
    assert reduction.jacobian(at).shape == (3, 4)
    assert not np.any(reduction_variance(reduction, at, 1e6 * np.eye(4), 100.0))


def test_noise_has_its_covariance():
    it = vehicle(covariance_eotvos=COVARIANCE)
    np.testing.assert_allclose(noise_covariance(it.gradiometer), np.array(COVARIANCE) * 1e-18)
    assert reading_sigma(it) == pytest.approx(2e-9)
    noise = np.concatenate([draw_noise(it, run, 500) for run in range(8)])
    nis = np.einsum("si,ij,sj->", noise, np.linalg.inv(noise_covariance(it.gradiometer)), noise)
    assert within_chi_square(nis, noise.size)
    assert noise.T @ noise / len(noise) * 1e18 == pytest.approx(np.array(COVARIANCE), abs=0.5)
    np.testing.assert_array_equal(noise[500:1000], draw_noise(it, 1, 500))
    assert reading_sigma(scenario("gradiometer.sigma_eotvos=3")) == pytest.approx(3e-9)


def test_readings_are_the_maps_channels():
    it = vehicle(sigma_eotvos=2.0)
    trajectory = build_trajectory(it)
    simulator = ReadingSimulator(it.true, trajectory, TENSOR, range(20))
    assert simulator.raw.shape == (20, 60, 2)
    i = simulator.index
    at = State(trajectory.latitude[i], trajectory.longitude[i], 100.0, 0.0, 0.0)
    reduced = GRADIENT.reduction(it).reduce(simulator.raw, at)
    noise = reduced - TENSOR.value(at.latitude, at.longitude)
    assert within_chi_square(((noise / (2.0 * EOTVOS)) ** 2).sum(), noise.size)
    alone = ReadingSimulator(it.true, trajectory, TENSOR, [7]).raw
    np.testing.assert_array_equal(alone[0], simulator.raw[7])


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("components=[nn,nx]", "components.1: must be 'nn', 'ne', 'nd', 'ee', 'ed' or 'dd', not"),
        ("components=[nn,nn]", "components: each once"),
        ("components=[nn,ne,nd,ee,ed,dd]", "components: must be a list of 5 or fewer"),
        ("platform_tilt=0.2", "platform_tilt"),
        ("map_errors=often", "map_errors"),
        ("covariance_eotvos=[[1,0],[0,1]]", "covariance_eotvos: must have 5 rows of 5 numbers"),
        (f"covariance_eotvos={(np.eye(5) - 2.0).tolist()}", "symmetric and positive definite"),
    ],
)
def test_wrong_settings_are_refused(override, words):
    with refusal(words):
        scenario(f"gradiometer.{override}")


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


def parameters(components, *more):
    """Those of a batch of three scans."""
    told = f"gradiometer.components=[{components}]", "matcher.batch_length=3"
    builder = BatchBuilder(load_scenario(None, ["field=gradient", *told, *more]))
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
