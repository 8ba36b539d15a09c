"""Continuation from level to level against point masses and dipoles, whose fields are known at all
heights."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.point_masses import HALF, MGAL, SIDE, STEP, attraction, drawn_errors, map_of, rms
from isogal.errors import InputError
from isogal.maps.continuation.level import to_level
from isogal.maps.error_spectrum import ErrorSpectrum
from isogal.maps.potential import INDEPENDENT, VECTOR, derivatives


@pytest.mark.parametrize("height", [100.0, 1000.0, 4000.0])
def test_upwards_from_level_to_level(height):
    """Within 0.03 mGal RMS of 2.5 mGal."""
    low = map_of(attraction(0.0), height=50.0)
    high = to_level(low, height + 50.0)
    kept = np.isfinite(high.values)
    assert kept.mean() == pytest.approx((1.0 - 5.0 * height / HALF) ** 2, abs=0.03)
    assert rms(high.values - attraction(height)) < 0.03 * MGAL
    assert rms(high.values) < rms(low.values[kept])
    assert (high.height, high.sigma, high.quantity) == (height + 50.0, 0.0, "disturbance")


def test_upwards_in_two_steps_is_upwards_in_one():
    low = map_of(attraction(0.0))
    once = to_level(low, 1500.0, 0.0, edge=20e3)
    twice = to_level(to_level(low, 500.0, 0.0), 1500.0, edge=17.5e3)
    assert twice.values.shape == (191, 191)  # the rim that the first step leaves out is cut off
    assert rms(twice.values - once.values[5:-5, 5:-5]) < 2e-3 * rms(once.values)


def test_the_rim(rough_map):
    """Part of a map against the same part of the whole map: within 21 % of the field at the rim
    (mirrored without the slope: 23 %), and within 2 % five heights from it."""
    inner = slice(60, -60)
    right = to_level(rough_map, 1000.0, 0.0).values[inner, inner]
    part = rough_map.part(inner, inner)
    error = to_level(part, 1000.0, 0.0, edge=0.0).values - right
    assert rms(error[:4]) < 0.21 * rms(right)
    assert rms(error[20:-20, 20:-20]) < 0.02 * rms(right)


def test_gradients_and_horizontal_components_upwards():
    low = map_of(attraction(0.0))
    for names in (INDEPENDENT, VECTOR):
        at_ground, above = (derivatives(low, names, height=h).channels for h in (0.0, 800.0))
        for one, right in zip(at_ground, above, strict=True):
            high = to_level(one, 800.0, 0.0)
            rim = (right.values.shape[0] - high.values.shape[0]) // 2
            expected = right.values[rim:-rim, rim:-rim]
            assert rms(high.values - expected) < 0.03 * rms(right.values), one.quantity


@pytest.mark.parametrize("cutoff", [2000.0, 3000.0, 4000.0])
@pytest.mark.parametrize("height", [500.0, 1000.0])
def test_downwards_comes_back_within_the_error_stated(height, cutoff):
    """Values on the upper level are wrong by white noise of 0.01 mGal."""
    noise = 0.01 * MGAL * drawn_errors(0)
    steps = 0.01 * MGAL * np.sqrt(12.0)
    high = map_of(attraction(height) + noise, height=height, quantisation=steps)
    low = to_level(high, 0.0, cutoff=cutoff)
    error = rms(low.values - attraction(0.0))
    assert 0.8 < low.sigma / error < 8.0
    assert error < 0.25 * MGAL
    assert low.quantisation == 0.0


@pytest.mark.parametrize("length", [None, 3000.0])
@pytest.mark.parametrize(("height", "cutoff"), [(800.0, None), (-400.0, 2500.0)])
def test_errors_of_the_map_go_through_the_continuation(length, height, cutoff):
    """Draws of white noise or of a field with covariance exp(-d / L), against sigma."""
    squares = []
    for seed in range(4):
        draw = map_of(MGAL * drawn_errors(seed, length))
        squares.append(rms(to_level(draw, height, 0.0, cutoff=cutoff, edge=8e3).values) ** 2)
    white = {"quantisation": MGAL * np.sqrt(12.0)}
    stated = {"sigma": MGAL, "correlation_length": length} if length else white
    flat = map_of(0.0 * SIDE[:, None] * SIDE, **stated)
    continued = to_level(flat, height, 0.0, cutoff=cutoff, edge=8e3)
    assert continued.sigma == pytest.approx(np.sqrt(np.mean(squares)), rel=0.08)


def test_gain_and_length_of_errors_upwards_are_those_of_the_closed_form():
    """Variance 1 - a π/2 (H0(a) - Y0(a)), a = 2h / L; length from L to 1.95 h."""
    from scipy.special import struve, y0

    spectrum = ErrorSpectrum.of_grid((20.0, 20.0), 4000.0)
    for height in (100.0, 1000.0, 10e3):
        a = 2.0 * height / 4000.0
        variance = 1.0 - a * np.pi / 2.0 * (struve(0, a) - y0(a))
        gain = spectrum.gain(lambda k, h=height: np.exp(-h * k))
        assert gain**2 == pytest.approx(variance, rel=3e-3)
    heights = 0.0, 100.0, 1000.0, 1e5
    lengths = [spectrum.length(lambda k, h=height: np.exp(-h * k)) for height in heights]
    assert lengths[0] == pytest.approx(4000.0, rel=3e-3)
    assert lengths == sorted(lengths)
    assert lengths[3] == pytest.approx(1.947e5, rel=0.02)


def test_sigma_of_each_node_is_continued():
    sigma = MGAL * np.linspace(1.0, 2.0, SIDE.size)[:, None] * np.ones(SIDE.size)
    low = map_of(attraction(0.0), sigma=sigma, correlation_length=3000.0)
    high = to_level(low, 1000.0, 0.0)
    gain = ErrorSpectrum.of_grid((STEP, STEP), 3000.0).gain(lambda k: np.exp(-1000.0 * k))
    np.testing.assert_allclose(high.sigma, gain * sigma, rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "keys", "message"),
    [
        ({"quantity": "gravity"}, {}, r"a map of gravity cannot be continued \(take the dist"),
        ({"height": None}, {}, r"give from_height \(--from-height\), or the terrain"),
        ({}, {"height": np.nan}, "height to continue to must be finite"),
        ({}, {"from_height": np.inf}, "height to continue from must be finite"),
        ({}, {"edge": -1.0}, "edge of the continuation must be >= 0 m"),
        ({}, {"height": -300.0}, r"300 m down .* grow 6.5\d times, .*--downward-cutoff"),
        ({}, {"cutoff": 3e3}, "a cut-off wavelength is for downward continuation"),
        ({}, {"height": -300.0, "cutoff": 900.0}, r"must be 1 \(two cells\) to 100 km .* 0.9"),
        ({}, {"height": 20e3}, "nothing is left of the map within 100 km"),
    ],
)
def test_what_cannot_be_continued_is_refused(changes, keys, message):
    low = replace(map_of(attraction(0.0, count=3)), **({"height": 0.0} | changes))
    with pytest.raises(InputError, match=message):
        to_level(low, **({"height": 500.0} | keys))
