"""The whole vector of the disturbing gravity: its horizontal components from a map of the
disturbance, or from maps of the deflection of the vertical.

Over a plane the disturbing potential T outside the masses is harmonic. With the axes north, east,
down, k = (k_n, k_e) and the disturbance g = dT/d(down) of transform G, the attraction to the north
and to the east has the transform (Heiskanen and Moritz 1967, Physical Geodesy, sections 2-14 and
2-22; Jekeli 2017, Spectral Methods in Geodesy and Geophysics)

    G_n = i k_n/|k| G,   G_e = i k_e/|k| G,   times exp(-|k| h) at a height h above the map,

so that the horizontal components together have the variance of the disturbance. The deflection of
the vertical is xi = -g_n / gamma, eta = -g_e / gamma with normal gravity gamma (section 2-22).

What the map cannot know. The factor is one at every wavelength, so unlike gradients the horizontal
components come from far away as well: masses beyond the map pull at all of it. The map is
continued by its mirror image, which fades to zero over `TAPER`. The error of one component at a
distance d from the rim is taken to be 1/sqrt(2) of the root mean square of the disturbance
continued upwards by d (by no more than a quarter of the map's width): the attraction of what is
unknown, at a distance d. It becomes part of sigma, and it is large: several mGal even in the
middle of a map of 400 km. Where there are maps of the deflection, they are better."""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.channels import ChannelMap
from isogal.maps.error_spectrum import ErrorSpectrum, mixed_length
from isogal.maps.field_map import FieldMap
from isogal.maps.spectral import Waves

COMPONENTS = ("disturbance", "gravity_north", "gravity_east")
"""Quantities of the channels: down, north, east."""
EDGE = 20_000.0
"""m at the rim and round holes without a result."""
TAPER = 200_000.0
"""m over which the continuation beyond the map fades to zero; measured, see docs/maps.md."""
_NODES = 300
"""A map is thinned to about so many nodes along an axis to see how long its waves are."""
_DISTANCES = 12


def horizontal_gravity(
    disturbance: FieldMap, height: float = 0.0, edge: float = EDGE, rim_error: bool = True
) -> ChannelMap:
    """Return maps of the attraction to the north and to the east, m/s², from one of the
    disturbance.

    Parameters
    ----------
    disturbance : FieldMap
        m/s², without large holes (small ones are filled, and the result is left out there).
    height : float
        m above the map's surface, >= 0.
    edge : float
        m at the rim and round holes that are left out, >= 0.
    rim_error : bool
        Whether sigma holds what lies beyond the map, which takes most of the time.

    Raises
    ------
    InputError
        Not a map of the disturbance, negative height or edge, too many holes, too small or too
        large a map.
    """
    return _components(disturbance, COMPONENTS[1:], height, edge, rim_error)


def gravity_vector(disturbance: FieldMap, height: float = 0.0) -> ChannelMap:
    """Return maps of the disturbance (down) and of the attraction to the north and to the east on
    one grid, see `horizontal_gravity`."""
    return _components(disturbance, COMPONENTS, height, EDGE)


def from_deflections(xi: FieldMap, eta: FieldMap) -> ChannelMap:
    """Return maps of the attraction to the north and to the east, m/s², from those of the
    deflection of the vertical to the north (xi) and to the east (eta), rad.

    Raises
    ------
    InputError
        Other quantities, or different grids.
    """
    channels = []
    for deflection, named, quantity in zip(
        (xi, eta), ("deflection_north", "deflection_east"), COMPONENTS[1:], strict=True
    ):
        if deflection.quantity != named:
            raise InputError(
                f"{deflection.provenance or 'map'}: must be a map of {named}, is one of"
                f" {deflection.quantity}"
            )
        gamma = normal_gravity(deflection.latitude, deflection.height or 0.0)
        sigma: float | Array = deflection.sigma
        channels.append(
            replace(
                deflection,
                values=-gamma[:, None] * deflection.values,
                unit="m/s²",
                quantity=quantity,
                sigma=(
                    sigma * float(gamma.mean())
                    if isinstance(sigma, float)
                    else sigma * gamma[:, None]
                ),
                quantisation=deflection.quantisation * float(gamma.mean()),
                file_unit="m/s²",
                file_factor=1.0,
            )
        )
    return ChannelMap(channels)


def _components(
    disturbance: FieldMap,
    quantities: tuple[str, ...],
    height: float,
    edge: float,
    rim_error: bool = True,
) -> ChannelMap:
    spectral.check_disturbance(disturbance, "horizontal components", height=height, edge=edge)
    values = np.asarray(disturbance.values, dtype=np.float64)
    missing = ~np.isfinite(values)
    kept = spectral.inside(disturbance, missing, edge)
    filled = np.where(missing, 0.0, values)
    operators = [partial(_operator, name, height) for name in quantities]
    result = spectral.transformed(disturbance, filled, operators, TAPER)
    result[:, ~kept] = np.nan
    own, length = _own_error(disturbance, height)
    beyond, reach = np.zeros(values.shape), 1.0
    if rim_error:
        beyond, reach = _sigma_beyond(disturbance, missing)
    # half of the variance of the map's own error goes into each horizontal component, with the
    # same correlation on the mean of all directions
    sideways = np.sqrt(0.5 * own**2 + beyond**2)
    mixed = mixed_length([(0.5 * own**2, length), (float(np.mean(beyond**2)), reach)])
    channels = []
    for name, one in zip(quantities, result, strict=True):
        down = name == "disturbance"
        channels.append(
            FieldMap(
                disturbance.latitude,
                disturbance.longitude,
                one,
                unit="m/s²",
                quantity=name,
                sigma=own if down else sideways,
                correlation_length=length if down else mixed,
                provenance=f"{name} of {disturbance.provenance or 'map'}",
                file_unit="m/s²",
                height=None if disturbance.height is None else disturbance.height + height,
            )
        )
    return ChannelMap(channels, result)


def _operator(quantity: str, height: float, waves: Waves) -> NDArray[Any]:
    """Return what the transform of a map of the disturbance is to be multiplied by."""
    decay = np.exp(-waves.size * height)
    if quantity == "disturbance":
        return decay
    k = waves.size.copy()
    k[0, 0] = 1.0  # a disturbance that is the same everywhere pulls to no side
    return 1j * (waves.odd_north if quantity == "gravity_north" else waves.odd_east) / k * decay


def _own_error(disturbance: FieldMap, height: float) -> tuple[float, float | None]:
    """Return sigma and correlation length (m) of what the map says of its errors, at a height."""
    spectrum = ErrorSpectrum.of_map(disturbance)

    def decay(wavenumber: Array) -> Array:
        return np.exp(-wavenumber * height)

    own = math.hypot(
        spectrum.sigma * spectrum.gain(decay), spectrum.rounding * spectrum.white_gain(decay)
    )
    return own, spectrum.length(decay)


def _sigma_beyond(disturbance: FieldMap, missing: NDArray[np.bool_]) -> tuple[Array, float]:
    """Return 1-sigma (n, m) of what masses beyond the map, and in its holes, do to a horizontal
    component; and the distance, m, over which that error holds together: half of the map."""
    cell = disturbance.cell
    width = min(size * count for size, count in zip(cell, missing.shape, strict=True))
    thinned = disturbance.thinned(*(count // _NODES for count in missing.shape))
    values = np.asarray(thinned.values, dtype=np.float64)
    distances = np.geomspace(max(cell), 0.25 * width, _DISTANCES)
    smooth = spectral.transformed(
        thinned,
        np.where(np.isfinite(values), values, 0.0),
        [partial(_operator, "disturbance", float(distance)) for distance in distances],
        TAPER,
    )
    scale = np.sqrt(0.5 * np.mean(smooth**2, axis=(1, 2)))
    away = spectral.rim_distance(missing, disturbance)
    return np.interp(away, distances, scale), 0.5 * float(width)
