"""The gradiometer: normal gradient, reduction, noise with covariance, and what a scenario may say
of it."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.statistics import within_chi_square
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.gravity import normal_gradient, normal_gravity
from isogal.errors import InputError
from isogal.fields.gradient import GRADIENT
from isogal.fields.map_error import TrueMapError
from isogal.fields.measured import measured_field, reading_sigma
from isogal.fields.simulator import ReadingSimulator
from isogal.maps.potential import derivatives
from isogal.scenario import TENSOR_COMPONENTS, Gravimeter, MapError, Route, Scenario, load_scenario
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
    latitude, step = np.radians(degrees), 10.0
    gradient = normal_gradient(latitude, 500.0)
    down = (normal_gravity(latitude, 500.0 - step) - normal_gravity(latitude, 500.0 + step)) / (
        2.0 * step
    )
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
    normal = [
        normal_gradient(-0.65, 200.0)[row, column]
        for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ]
    np.testing.assert_allclose(felt - value, np.tile(normal, (3, 1)), atol=1e-17)
    np.testing.assert_allclose(reduction.reduce(felt, at), value, atol=1e-6 * EOTVOS)
    far = State(-0.65 + 1e3 / 6.37e6, 2.5, 205.0, 15.0, 15.0)
    assert np.abs(reduction.reduce(felt, far) - value).max() < 0.01 * EOTVOS
    assert reduction.jacobian(at).shape == (3, 4)
    assert not np.any(reduction_variance(reduction, at, 1e6 * np.eye(4), 100.0))


def test_noise_has_its_covariance():
    it = scenario(
        "gradiometer.components=[nd,ee]",
        f"gradiometer.covariance_eotvos={[list(row) for row in COVARIANCE]}",
    )
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
    noise = GRADIENT.reduction(it).reduce(simulator.raw, at) - TENSOR.value(
        at.latitude, at.longitude
    )
    assert within_chi_square(((noise / (2.0 * EOTVOS)) ** 2).sum(), noise.size)
    alone = ReadingSimulator(it.true, trajectory, TENSOR, [7]).raw
    np.testing.assert_array_equal(alone[0], simulator.raw[7])


def test_each_channel_has_a_map_error_of_its_own():
    it = vehicle().model_copy(
        update={"map_error": MapError(sigma=5e-9, correlation_length=3000.0)}
    )
    trajectory = build_trajectory(it)
    errors = TrueMapError(it.true, trajectory, np.arange(10, 601, 10), range(40)).at_scans((2,))
    assert errors.shape == (40, 60, 2)
    assert errors.std() == pytest.approx(5e-9, rel=0.2)
    assert abs(np.mean(errors[..., 0] * errors[..., 1])) < 0.2 * 25e-18
    assert np.mean(errors[:, 1:] * errors[:, :-1]) > 0.8 * 25e-18


def test_a_map_of_another_quantity_is_refused():
    it = vehicle()
    with pytest.raises(
        InputError, match="a gradiometer does not measure disturbance; give gradient"
    ):
        ReadingSimulator(it.true, build_trajectory(it), field_map_of(wavy, half=50e3), [0])
    holed = replace(
        TENSOR.channels[1], values=np.where(TENSOR.channels[1].values > 0.0, np.nan, 1.0)
    )
    with pytest.raises(InputError, match="does not cover the route at latitude"):
        ReadingSimulator(
            it.true, build_trajectory(it), type(TENSOR)([TENSOR.channels[0], holed]), [0]
        )


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "gradiometer.components=[nn,nx]",
            f"components: unknown 'nx'; allowed: {', '.join(TENSOR_COMPONENTS)}",
        ),
        ("gradiometer.components=[nn,nn]", "components: each once"),
        ("gradiometer.components=[]", "gradiometer.components: tuple should have at least 1 item"),
        (
            "gradiometer.components=[nn,ne,nd,ee,ed,dd]",
            "gradiometer.components: tuple should have at most 5 items",
        ),
        ("gradiometer.sigma_eotvos=0", "gradiometer.sigma_eotvos: input should be greater than 0"),
        (
            "gradiometer.sigma=1",
            "unknown key 'gradiometer.sigma', did you mean 'gradiometer.sigma_eotvos'",
        ),
        (
            "gradiometer.covariance_eotvos=[[1,0],[0,1]]",
            "covariance_eotvos: must have 5 rows of 5 numbers",
        ),
        (
            f"gradiometer.covariance_eotvos={(np.eye(5) - 2.0).tolist()}",
            "must be symmetric and positive definite",
        ),
    ],
)
def test_wrong_settings_are_refused(override, words):
    with pytest.raises(InputError) as error:
        scenario(override)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_the_gravimeters_sigma_does_not_matter():
    with pytest.raises(
        InputError,
        match=r"sigma: says nothing where field is gradient, .* in the section gradiometer",
    ):
        measured_field(scenario("gravimeter.sigma=1e-9"))
    assert (
        measured_field(Scenario(field="gradient", gravimeter=Gravimeter(interval=5.0))).source
        == "disturbance"
    )
