"""The gradient tensor by FFT against a point mass and a plane wave, whose tensors are known."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.gradients import COMPONENTS, INDEPENDENT, error_length, tensor_maps

GRAVITATIONAL = 6.6743e-11


def point_mass(north, east, depth, mass=3e12):
    """Disturbance and tensor (six components, axes north, east, down) of a point mass below the
    origin."""
    gm = GRAVITATIONAL * mass
    position = np.stack(np.broadcast_arrays(north, east, -float(depth)))
    r2 = (position**2).sum(axis=0)
    index = {"n": 0, "e": 1, "d": 2}
    tensor = {
        name: gm
        * (
            3.0 * position[index[name[0]]] * position[index[name[1]]] / r2**2.5
            - (name[0] == name[1]) / r2**1.5
        )
        for name in COMPONENTS
    }
    return gm * depth / r2**1.5, tensor


def local_metres(field_map):
    metres = metres_per_radian(ORIGIN[0])
    return (field_map.latitude - ORIGIN[0])[:, None] * metres[0], (
        field_map.longitude - ORIGIN[1]
    )[None, :] * metres[1]


@pytest.mark.parametrize("height", [0.0, 1500.0])
def test_point_mass(height):
    depth = 4000.0
    field_map = field_map_of(lambda n, e: point_mass(n, e, depth)[0], half=60e3, step=500.0)
    maps = tensor_maps(field_map, COMPONENTS, height=height)
    north, east = local_metres(field_map)
    _, expected = point_mass(north, east, depth + height)
    largest = np.abs(expected["dd"]).max()
    for name, channel in zip(COMPONENTS, maps.channels, strict=True):
        inside = np.isfinite(channel.values)
        assert 0.3 < inside.mean() < 0.5  # 20 km of 60 km are left out on each side
        assert np.abs(channel.values - expected[name])[inside].max() < 0.01 * largest, name
        assert (channel.unit, channel.quantity) == ("1/s²", "gradient")


def test_the_trace_is_zero_and_the_gradient_of_the_disturbance_is_in_it():
    field_map = field_map_of(
        lambda n, e: point_mass(n - 3e3, e + 2e3, 5000.0)[0], half=60e3, step=500.0
    )
    maps = dict(zip(COMPONENTS, tensor_maps(field_map, COMPONENTS).channels, strict=True))
    trace = maps["nn"].values + maps["ee"].values + maps["dd"].values
    scale = np.nanmax(np.abs(maps["dd"].values))
    assert np.nanmax(np.abs(trace)) < 1e-9 * scale
    latitude, longitude = np.meshgrid(field_map.latitude, field_map.longitude, indexing="ij")
    _, by_north, by_east = field_map.value_and_gradient(latitude, longitude)
    for name, slope in (("nd", by_north), ("ed", by_east)):
        assert np.nanmax(np.abs(maps[name].values - slope)) < 0.02 * scale


def test_a_wave_to_the_north_east_at_another_latitude():
    """Wave length 8 km; each component is the wave's amplitude times its own factor and phase."""
    length, amplitude = 8000.0, 1e-4
    k = 2.0 * np.pi / length

    def wave(n, e, phase=0.0):
        return amplitude * np.cos(k * (0.6 * n + 0.8 * e) + phase)

    field_map = field_map_of(wave, half=60e3, step=250.0)
    maps = dict(
        zip(COMPONENTS, tensor_maps(field_map, COMPONENTS, height=800.0).channels, strict=True)
    )
    north, east = local_metres(field_map)
    decay = np.exp(-k * 800.0)
    factor = {"nn": -0.36, "ne": -0.48, "ee": -0.64, "dd": 1.0}
    for name, channel in maps.items():
        phase = 0.0 if name in factor else np.pi / 2
        expected = (
            k * decay * factor.get(name, 0.6 if name == "nd" else 0.8) * wave(north, east, phase)
        )
        inside = np.isfinite(channel.values)
        assert np.abs(channel.values - expected)[inside].max() < 0.03 * k * decay * amplitude, name


def test_degrees_of_longitude_get_shorter_to_the_south():
    """A map four degrees high: a mass far south of its middle still has the tensor that its own
    surroundings have."""
    latitude = np.radians(np.arange(-40.0, -35.9, 0.01))
    longitude = np.radians(np.arange(146.0, 148.01, 0.01))
    middle = np.radians(-39.0), np.radians(147.0)
    metres = metres_per_radian(middle[0])
    north = (latitude - middle[0])[:, None] * metres[0]
    east = (longitude - middle[1])[None, :] * metres_per_radian(latitude)[1][:, None]
    disturbance, expected = point_mass(north, east, 6000.0)
    small = field_map_of(lambda n, e: n + e, step=2000.0)
    field_map = replace(
        small, latitude=latitude, longitude=longitude, values=disturbance, quantity="disturbance"
    )
    maps = tensor_maps(field_map)
    near = np.hypot(north, east) < 15e3
    for name, channel in zip(INDEPENDENT, maps.channels, strict=True):
        assert (
            np.abs(channel.values - expected[name])[near].max()
            < 0.015 * np.abs(expected["dd"]).max()
        ), name


def test_a_hole_is_left_out_with_its_surroundings():
    field_map = field_map_of(lambda n, e: point_mass(n, e, 5000.0)[0], half=60e3, step=500.0)
    values = field_map.values.copy()
    values[150:154, 150:154] = np.nan
    channel = tensor_maps(replace(field_map, values=values), ("dd",), edge=5e3).channels[0]
    assert np.isnan(channel.values[152 - 9 : 152 + 9, 152]).all()
    assert np.isfinite(channel.values[152 - 14, 152])
    whole = tensor_maps(field_map, ("dd",), edge=5e3).channels[0]
    far = np.isfinite(channel.values)
    assert np.abs(channel.values - whole.values)[far].max() < 0.1 * np.nanmax(whole.values)


@pytest.mark.parametrize(
    ("changes", "keys", "message"),
    [
        (
            {"quantity": "height", "unit": "m"},
            {},
            "gradients come from a map of the disturbance, not of height",
        ),
        (
            {},
            {"components": ("zz",)},
            "unknown tensor component zz; known: nn, ne, nd, ee, ed, dd",
        ),
        ({}, {"components": ()}, r"unknown tensor component \(none\)"),
        ({}, {"height": -1.0}, "height of the gradients must be >= 0 m"),
        ({}, {"edge": 50e3}, "nothing is left of the map within 50 km of its edges"),
    ],
)
def test_maps_without_gradients_are_refused(changes, keys, message):
    field_map = replace(field_map_of(lambda n, e: 1e-9 * n, step=1000.0), **changes)
    with pytest.raises(InputError, match=message):
        tensor_maps(field_map, **keys)


def test_a_map_that_is_mostly_missing_or_too_tall_is_refused():
    field_map = field_map_of(lambda n, e: 1e-9 * n, step=1000.0)
    holed = np.where(np.arange(81)[:, None] < 30, np.nan, field_map.values)
    with pytest.raises(InputError, match="37 % of the map is missing"):
        tensor_maps(replace(field_map, values=holed))
    tall = replace(field_map, latitude=np.linspace(-1.2, -0.2, 81))
    with pytest.raises(InputError, match="reaches too far north-south"):
        tensor_maps(tall)


@pytest.mark.parametrize("length", [None, 3000.0])
def test_errors_of_the_map_go_through_the_transform(length):
    """Draws of white noise or of a field with covariance exp(-d / L), against the gain by their
    spectrum."""
    flat = field_map_of(lambda n, e: 0.0 * n * e, half=60e3, step=600.0)
    n, m = flat.values.shape
    side = 600.0 * np.arange(2 * n)
    distance = np.hypot(
        *np.meshgrid(
            np.minimum(side, 2 * n * 600.0 - side), np.minimum(side, 2 * n * 600.0 - side)
        )
    )
    # circulant embedding: the spectrum of the covariance on a torus twice as large
    power = (
        np.ones((2 * n, 2 * n))
        if length is None
        else np.maximum(np.fft.fft2(np.exp(-distance / length)).real, 0.0)
    )
    spread = {name: [] for name in COMPONENTS}
    for seed in range(6):
        white = np.random.default_rng(seed).standard_normal((2 * n, 2 * n))
        values = 1e-5 * np.fft.ifft2(np.sqrt(power) * np.fft.fft2(white)).real[:n, :m]
        for name, channel in zip(
            COMPONENTS,
            tensor_maps(replace(flat, values=values), COMPONENTS, height=200.0).channels,
            strict=True,
        ):
            spread[name].append(np.nanmean(channel.values**2))
    told = (
        {"quantisation": 1e-5} if length is None else {"sigma": 1e-5, "correlation_length": length}
    )
    maps = tensor_maps(replace(flat, **told), COMPONENTS, height=200.0)
    for name, channel in zip(COMPONENTS, maps.channels, strict=True):
        gain = channel.quantisation if length is None else channel.sigma
        assert gain == pytest.approx(np.sqrt(np.mean(spread[name])), rel=0.05), name
        assert (channel.sigma if length is None else channel.quantisation) == 0.0


def test_errors_of_a_gradient_hold_together_over_the_height_or_a_cell():
    fine, coarse = (200.0, 200.0), (900.0, 900.0)
    for name in COMPONENTS:
        assert 0.3 * 900.0 < error_length(name, coarse, 100.0, 4000.0) < 1.5 * 900.0, name
        assert 1.0 < error_length(name, fine, 1000.0, 4000.0) / 2000.0 < 2.0, name
        assert error_length(name, fine, 100.0, 4000.0) < error_length(name, fine, 400.0, 4000.0), (
            name
        )
    assert error_length("dd", fine, 100.0, 4000.0) == pytest.approx(
        error_length("dd", fine, 100.0, 8000.0), rel=0.1
    )
