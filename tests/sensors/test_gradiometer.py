"""The gradiometer: normal gradient, reduction, noise with covariance, and what a scenario may say
of it."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.refusals import refusal
from helpers.statistics import within_chi_square
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.gravity import normal_gradient, normal_gravity
from isogal.errors import InputError
from isogal.fields.gradient import GRADIENT
from isogal.fields.map_error import TrueMapError
from isogal.fields.measured import measured_field, reading_sigma
from isogal.fields.simulator import ReadingSimulator
from isogal.maps.potential import derivatives
from isogal.scenario import TENSOR_COMPONENTS, MapError, Route, Scenario, load_scenario
from isogal.sensors.gradiometer import GradientReduction
from isogal.sensors.gradiometer_errors import EOTVOS, noise_covariance, noise_of
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


@pytest.mark.parametrize("degrees", [-80.0, -38.0, 0.0, 10.0, 55.0])
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


def test_all_components_of_an_outlier_are_outliers():
    it = scenario("gravimeter.outlier_fraction=0.1", "gravimeter.outlier_sigma=1000")
    large = np.abs(draw_noise(it, 0, 4000)) > 20.0 * EOTVOS
    assert 0.05 < large.any(axis=1).mean() < 0.15
    assert large[large.any(axis=1)].mean() > 0.95


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


def test_each_channel_has_a_map_error_of_its_own():
    error = MapError(sigma=5e-9, correlation_length=3000.0)
    it = vehicle().model_copy(update={"map_error": error})
    trajectory = build_trajectory(it)
    errors = TrueMapError(it.true, trajectory, np.arange(10, 601, 10), range(40)).at_scans((2,))
    assert errors.shape == (40, 60, 2)
    assert errors.std() == pytest.approx(5e-9, rel=0.2)
    assert abs(np.mean(errors[..., 0] * errors[..., 1])) < 0.2 * 25e-18
    assert np.mean(errors[:, 1:] * errors[:, :-1]) > 0.8 * 25e-18


def test_maps_that_cannot_be_used():
    """One of another quantity, and one with a hole in its second channel."""
    it = vehicle()
    trajectory, (first, second) = build_trajectory(it), TENSOR.channels
    with refusal("a gradiometer does not measure disturbance; give gradient"):
        ReadingSimulator(it.true, trajectory, field_map_of(wavy, half=50e3), [0])
    holed = replace(second, values=np.where(second.values > 0.0, np.nan, 1.0))
    with refusal("does not cover the route at latitude"):
        ReadingSimulator(it.true, trajectory, type(TENSOR)([first, holed]), [0])


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("components=[nn,nx]", f"unknown 'nx'; allowed: {', '.join(TENSOR_COMPONENTS)}"),
        ("components=[nn,nn]", "components: each once"),
        ("components=[]", "gradiometer.components: must be a list of 1 or more"),
        ("components=[nn,ne,nd,ee,ed,dd]", "components: must be a list of 5 or fewer"),
        ("sigma_eotvos=0", "gradiometer.sigma_eotvos: must be greater than 0"),
        ("sigma=1", "unknown key 'gradiometer.sigma', did you mean 'gradiometer.sigma_eotvos'"),
        ("covariance_eotvos=[[1,0],[0,1]]", "covariance_eotvos: must have 5 rows of 5 numbers"),
        (f"covariance_eotvos={(np.eye(5) - 2.0).tolist()}", "symmetric and positive definite"),
    ],
)
def test_wrong_settings_are_refused(override, words):
    with refusal(words):
        scenario(f"gradiometer.{override}")


def test_the_gravimeters_sigma_does_not_matter():
    with pytest.raises(InputError, match=r"sigma: says nothing .* in the section gradiometer"):
        measured_field(scenario("gravimeter.sigma=1e-9"))
    assert measured_field(scenario("gravimeter.interval=5")).source == "disturbance"
