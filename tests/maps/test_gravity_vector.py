"""Horizontal components of gravity against a point mass, against random fields whose components
are known, and against the gradient tensor."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps.gradients import tensor_maps
from isogal.maps.gravity_vector import from_deflections, gravity_vector, horizontal_gravity

GRAVITATIONAL = 6.6743e-11
MGAL = 1e-5


def attraction(north, east, depth, mass=3e14):
    """Attraction of a point mass below the origin: down, north, east."""
    gm = GRAVITATIONAL * mass
    r3 = (north**2 + east**2 + depth**2) ** 1.5
    return gm * depth / r3, -gm * north / r3, -gm * east / r3


def sides(half, step):
    side = np.arange(-half, half + step / 2, step)
    return side[:, None], side[None, :]


@pytest.mark.parametrize("height", [0.0, 1500.0, 6000.0])
@pytest.mark.parametrize("depth", [3000.0, 8000.0])
def test_point_mass(depth, height):
    """Within 1.2 % of the largest attraction, in a map of 120 km; that is what is beyond it."""
    disturbance = field_map_of(lambda n, e: attraction(n, e, depth)[0], half=60e3, step=750.0)
    vector = gravity_vector(disturbance, height)
    expected = attraction(*sides(60e3, 750.0), depth + height)
    largest = expected[0].max()
    assert [one.quantity for one in vector.channels] == [
        "disturbance",
        "gravity_north",
        "gravity_east",
    ]
    for channel, right in zip(vector.channels, expected, strict=True):
        kept = np.isfinite(channel.values)
        assert 0.4 < kept.mean() < 0.5  # 20 km of 60 km are left out on each side
        assert np.abs(channel.values - right)[kept].max() < 0.012 * largest
        assert channel.unit == "m/s²"


def random_field(nodes, step, seed):
    """Disturbance and its horizontal components on a torus: 28 mGal RMS, with the spectrum of
    Tscherning and Rapp (1974) from degree 10."""
    k_n = 2.0 * np.pi * np.fft.fftfreq(nodes, step)[:, None]
    k_e = 2.0 * np.pi * np.fft.rfftfreq(nodes, step)[None, :]
    k = np.hypot(k_n, k_e)
    k[0, 0] = 1.0
    degree = 6.371e6 * k
    power = np.exp(-2.0 * k * 3e3) / ((degree + 1.0) * (degree + 24.0))
    power *= np.minimum(degree / 10.0, 1.0) ** 4
    power[0, 0] = 0.0
    white = np.random.default_rng(seed).standard_normal((nodes, nodes))
    transform = np.fft.rfft2(white) * np.sqrt(power)
    transform *= 28.0 * MGAL / np.fft.irfft2(transform).std()
    odd_n, odd_e = k_n.copy(), k_e.copy()
    odd_n[nodes // 2], odd_e[:, -1] = 0.0, 0.0
    return tuple(
        np.fft.irfft2(transform * factor) for factor in (1.0, 1j * odd_n / k, 1j * odd_e / k)
    )


def windows(width=400e3, step=4000.0):
    """Windows of random fields, as maps, with their true horizontal components."""
    nodes = round(width / step)
    for seed in range(5):
        fields = random_field(1024, step, seed)
        for row, column in itertools.product(range(0, 1024 - nodes, 4 * nodes), repeat=2):
            cut = slice(row, row + nodes), slice(column, column + nodes)
            small = field_map_of(lambda n, e: 0.0 * n * e, half=0.5 * width, step=step)
            yield (
                replace(
                    small,
                    latitude=small.latitude[:nodes],
                    longitude=small.longitude[:nodes],
                    values=fields[0][cut],
                ),
                fields[1][cut],
                fields[2][cut],
            )


def test_sigma_says_what_is_unknown_beyond_the_map():
    """Maps of 400 km cut out of random fields. From field to field the error in the middle varies
    by a third, as few long waves make it."""
    rim, middle = [], []
    for disturbance, *expected in windows():
        for channel, right in zip(
            horizontal_gravity(disturbance, edge=8e3).channels, expected, strict=True
        ):
            error, sigma = channel.values - right, np.asarray(channel.sigma)
            rim.append((np.mean(error[3:8, 3:-3] ** 2), np.mean(sigma[3:8, 3:-3] ** 2)))
            middle.append((np.mean(error[40:60, 40:60] ** 2), np.mean(sigma[40:60, 40:60] ** 2)))
            assert channel.correlation_length == pytest.approx(200e3, rel=0.05)
    for place, least, most in ((rim, 8.0, 12.0), (middle, 4.0, 8.0)):
        error, sigma = np.sqrt(np.mean(place, axis=0)) / MGAL
        assert least < error < most
        assert 1.0 < sigma / error < 1.9


def test_the_field_has_no_curl_and_its_slope_is_the_gradient_tensor():
    disturbance = field_map_of(
        lambda n, e: attraction(n - 3e3, e + 2e3, 6000.0)[0], half=60e3, step=500.0
    )
    north, east = horizontal_gravity(disturbance).channels
    tensor = tensor_maps(disturbance, ("nn", "ne", "ee")).channels
    step = disturbance.cell_size_m(ORIGIN[0])
    north_by_north, north_by_east = np.gradient(north.values, *step)
    east_by_north, east_by_east = np.gradient(east.values, *step)
    scale = np.nanmax(np.abs(tensor[0].values))
    assert np.nanmax(np.abs(north_by_east - east_by_north)) < 2e-3 * scale
    for slope, component in zip(
        (north_by_north, north_by_east, east_by_east), tensor, strict=True
    ):
        assert np.nanmax(np.abs(slope - component.values)) < 0.02 * scale


def test_deflections_become_gravity_and_back():
    xi = replace(
        field_map_of(lambda n, e: 1e-9 * n + 2e-10 * e, step=1000.0),
        unit="rad",
        quantity="deflection_north",
        sigma=1e-6,
        correlation_length=3000.0,
        quantisation=4.8e-7,
    )
    eta = replace(xi, values=xi.values[:, ::-1], quantity="deflection_east")
    north, east = from_deflections(xi, eta).channels
    gamma = normal_gravity(xi.latitude)[:, None]
    np.testing.assert_allclose(-north.values / gamma, xi.values, rtol=1e-14)
    np.testing.assert_allclose(-east.values / gamma, eta.values, rtol=1e-14)
    assert (north.quantity, east.quantity, north.unit) == ("gravity_north", "gravity_east", "m/s²")
    assert north.sigma == pytest.approx(9.798e-6, rel=1e-3)
    assert north.quantisation == pytest.approx(0.47 * MGAL, rel=0.01)
    assert north.correlation_length == 3000.0


def test_errors_of_the_map_go_into_each_component():
    """Half of the variance each; without masses beyond the map nothing else."""
    flat = field_map_of(lambda n, e: 0.0 * n * e, half=60e3, step=1000.0)
    told = replace(flat, sigma=2 * MGAL, correlation_length=3000.0, height=100.0)
    down, north, east = gravity_vector(told).channels
    assert down.sigma == pytest.approx(2 * MGAL)
    for one in (north, east):
        np.testing.assert_allclose(one.sigma, np.sqrt(2.0) * MGAL, rtol=1e-3)
        assert one.correlation_length == pytest.approx(down.correlation_length, rel=1e-6)
    assert gravity_vector(told, 900.0).channels[0].height == 1000.0
    assert gravity_vector(told, 900.0).channels[0].sigma < 1.6 * MGAL
    assert [one.correlation_length for one in gravity_vector(flat).channels] == [None] * 3
    assert gravity_vector(replace(flat, quantisation=1e-6)).channels[0].sigma > 0.28e-6


@pytest.mark.parametrize(
    ("changes", "keys", "message"),
    [
        ({"quantity": "height", "unit": "m"}, {}, "disturbance, not of height"),
        ({}, {"height": -1.0}, "height of the horizontal components must be >= 0 m"),
        ({}, {"edge": np.nan}, "edge of the horizontal components must be >= 0 m"),
        ({}, {"edge": 50e3}, "nothing is left of the map within 50 km"),
        ({"latitude": np.linspace(-1.2, -0.2, 81)}, {}, "reaches too far north-south"),
    ],
)
def test_what_has_no_horizontal_components_is_refused(changes, keys, message):
    disturbance = replace(field_map_of(lambda n, e: 1e-9 * n, step=1000.0), **changes)
    with pytest.raises(InputError, match=message):
        horizontal_gravity(disturbance, **keys)


def test_other_maps_are_no_deflections():
    disturbance = field_map_of(lambda n, e: 1e-9 * n, step=1000.0)
    with pytest.raises(InputError, match="must be a map of deflection_north, is one of dist"):
        from_deflections(disturbance, disturbance)
