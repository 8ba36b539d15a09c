"""The gravity vector and the gradient tensor by FFT: against a point mass, a plane wave and random
fields whose components are known."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps.potential import (
    COMPONENTS,
    VECTOR,
    derivatives,
    from_deflections,
)

GM = 6.6743e-11 * 3e14
MGAL = 1e-5
OF_TRACE = ("nn", "ee", "dd")


def point_mass(north, east, depth):
    """Attraction and tensor of a point mass below the origin, by component."""
    position = np.stack(np.broadcast_arrays(north, east, -float(depth)))
    r2 = (position**2).sum(axis=0)
    n, e, d = -GM * position / r2**1.5
    of = dict(zip("ned", position, strict=True))
    tensor = {
        name: GM * (3.0 * of[name[0]] * of[name[1]] / r2**2.5 - (name[0] == name[1]) / r2**1.5)
        for name in COMPONENTS
    }
    return {"disturbance": d, "gravity_north": n, "gravity_east": e} | tensor


def map_of_mass(depth, shift=(0.0, 0.0)):
    def down(n, e):
        return point_mass(n + shift[0], e + shift[1], depth)["disturbance"]

    return field_map_of(down, half=60e3, step=500.0)


def local_metres(field_map):
    north, east = metres_per_radian(ORIGIN[0])
    return (
        (field_map.latitude - ORIGIN[0])[:, None] * north,
        (field_map.longitude - ORIGIN[1])[None, :] * east,
    )


@pytest.mark.parametrize(("depth", "height"), [(3000.0, 0.0), (8000.0, 1500.0)])
@pytest.mark.parametrize("names", [VECTOR, COMPONENTS], ids=["vector", "tensor"])
def test_point_mass(depth, height, names):
    """Within about a per cent of the largest, in a map of 120 km; for the vector that is what is
    beyond it."""
    disturbance = map_of_mass(depth)
    expected = point_mass(*local_metres(disturbance), depth + height)
    maps = derivatives(disturbance, names, height=height).channels
    largest = np.abs(expected["disturbance" if names is VECTOR else "dd"]).max()
    if names is COMPONENTS:
        trace = sum(one.values for name, one in zip(names, maps, strict=True) if name in OF_TRACE)
        assert np.nanmax(np.abs(trace)) < 1e-9 * largest
    for name, channel in zip(names, maps, strict=True):
        kept = np.isfinite(channel.values)
        assert 0.4 < kept.mean() < 0.5  # 20 km of 60 km are left out on each side
        assert np.abs(channel.values - expected[name])[kept].max() < 0.012 * largest, name
        said = ("m/s²", name) if names is VECTOR else ("1/s²", "gradient")
        assert (channel.unit, channel.quantity) == said


def test_a_hole_is_left_out_with_its_surroundings():
    field_map = map_of_mass(5000.0)
    values = field_map.values.copy()
    values[150:154, 150:154] = np.nan
    channel = derivatives(replace(field_map, values=values), ("dd",), edge=5e3).channels[0]
    assert np.isnan(channel.values[152 - 9 : 152 + 9, 152]).all()
    assert np.isfinite(channel.values[152 - 14, 152])
    whole = derivatives(field_map, ("dd",), edge=5e3).channels[0]
    far = np.isfinite(channel.values)
    assert np.abs(channel.values - whole.values)[far].max() < 0.1 * np.nanmax(whole.values)


SMALL = field_map_of(lambda n, e: 1e-9 * n, step=1000.0)
HOLED = np.where(np.arange(81)[:, None] < 30, np.nan, SMALL.values)


@pytest.mark.parametrize(
    ("changes", "keys", "message"),
    [
        ({"quantity": "height", "unit": "m"}, {}, "gradients come from a map of the disturbance"),
        ({}, {"height": -1.0}, "height of the gradients must be >= 0 m"),
        ({}, {"edge": 50e3}, "nothing is left of the map within 50 km of its edges"),
        ({"values": HOLED}, {}, "37 % of the map is missing"),
        ({"latitude": np.linspace(-1.2, -0.2, 81)}, {}, "reaches too far north-south"),
        ({}, {"components": ("zz",)}, "unknown tensor component zz; known: nn, ne, nd, ee, ed"),
        ({}, {"components": ()}, "unknown tensor component ; known: nn"),
    ],
)
def test_maps_without_derivatives_are_refused(changes, keys, message):
    with pytest.raises(InputError, match=message):
        derivatives(replace(SMALL, **changes), **keys)


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
    with pytest.raises(InputError, match="must be a map of deflection_north, is one of dist"):
        from_deflections(SMALL, SMALL)
