"""Derivatives of the disturbing potential from a map of the gravity disturbance, by Fourier
transform: the whole vector of the disturbing gravity, and its gradient tensor.

Over a plane the disturbing potential T outside the masses is harmonic, so each of its wavelengths
decays upwards as exp(-|k| h), and any derivative of T follows from any other (Blakely 1995,
Potential Theory in Gravity and Magnetic Applications, chapter 11; Heiskanen and Moritz 1967,
Physical Geodesy, sections 2-14 and 2-22; Jekeli 2017, Spectral Methods in Geodesy and Geophysics).
With the axes north, east, down, k = (k_n, k_e) and the disturbance g = dT/d(down) of transform G:

    G_n = i k_n/|k| G,   G_e = i k_e/|k| G,
    T_dd = |k| G,   T_nd = i k_n G,   T_ed = i k_e G,
    T_nn = -k_n²/|k| G,   T_ee = -k_e²/|k| G,   T_ne = -k_n k_e/|k| G,

times exp(-|k| h) at a height h above the map. So the horizontal components of gravity together
have the variance of the disturbance, and of the tensor five components are independent, as T_nn +
T_ee + T_dd = 0. The deflection of the vertical is xi = -g_n / gamma, eta = -g_e / gamma with
normal gravity gamma (Heiskanen and Moritz, section 2-22). `isogal.maps.spectral` does the
transforms.

Edges. What lies beyond the map is unknown: the map is continued by its mirror image, which fades
to zero by a cosine. What that changes is largest at the rim, where results are left out.

- Gradients are local: the map's mean is taken off, the continuation fades over 20 km.
- Of horizontal gravity the factor is one at every wavelength, so it comes from far away as well:
  masses beyond the map pull at all of it. The continuation fades over 200 km, and leaves an error
  of several mGal even in the middle of a map of 400 km, which sigma does not hold (docs/maps.md).
  Where there are maps of the deflection, they are better."""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from isogal.arrays import Array
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.channels import ChannelMap
from isogal.maps.error_model import shares
from isogal.maps.error_spectrum import ErrorSpectrum
from isogal.maps.field_map import FieldMap
from isogal.maps.spectral import Spectrum, Waves
from isogal.scenario import TENSOR_COMPONENTS

VECTOR = ("disturbance", "gravity_north", "gravity_east")
"""Components of gravity, and quantities of their maps: down, north, east."""
COMPONENTS = TENSOR_COMPONENTS
"""Second derivatives of the disturbing potential by north (n), east (e) and down (d)."""
INDEPENDENT = COMPONENTS[:5]
"""Five that say all: dd = -nn - ee."""
EDGE = 20_000.0
"""m at the rim and round holes without a result."""
_TENSOR_TAPER, _VECTOR_TAPER = 20_000.0, 200_000.0
"""m over which the continuation beyond the map fades out; measured, see docs/maps.md."""


def disturbance_of(field_map: FieldMap) -> FieldMap:
    """Return a map of the gravity disturbance from one of it, or of gravity on the ellipsoid."""
    if field_map.quantity == "disturbance":
        return field_map
    normal = normal_gravity(field_map.latitude)[:, None]
    return replace(field_map, values=field_map.values - normal, quantity="disturbance")


def derivatives(
    disturbance: FieldMap,
    components: tuple[str, ...] = INDEPENDENT,
    *,
    height: float = 0.0,
    edge: float = EDGE,
) -> ChannelMap:
    """Return maps of components of the gravity vector, in m/s², or of its gradient tensor, in 1/s²
    (1 E = 1e-9 1/s²), one channel each; NaN at the rim.

    What the map says of its errors goes through the same transform: its sigma, as of a field with
    covariance sigma² exp(-d / L), and its step of values, as white noise of the nodes, become
    sigma and step of each channel. The errors of a gradient hold together over a cell or the
    height, whichever is larger, and not over L: each channel has a correlation length of its own.

    Parameters
    ----------
    disturbance : FieldMap
        Gravity disturbance, m/s², without holes (small ones are filled, and the result is left out
        there).
    components : tuple of str
        Of `COMPONENTS`, or of `VECTOR`.
    height : float
        m above the map's surface that the field is continued to, >= 0.
    edge : float
        m at the rim and round holes that are left out, >= 0.

    Raises
    ------
    InputError
        Not a map of the disturbance, unknown component, negative height, too many holes, too small
        or too large a map.
    """
    of_vector = bool(components) and components[0] in VECTOR
    known = VECTOR if of_vector else COMPONENTS
    if not components or not set(components) <= set(known):
        raise InputError(
            f"unknown tensor component {', '.join(components)}; known: {', '.join(known)}"
        )
    what = "horizontal components" if of_vector else "gradients"
    if disturbance.quantity != "disturbance":
        raise InputError(
            f"{disturbance.provenance or 'map'}: {what} come from a map of the disturbance, not of"
            f" {disturbance.quantity}"
        )
    if height < 0.0:
        raise InputError(f"height of the {what} must be >= 0 m, is {height}")
    spectral.check_plane(disturbance, what)
    values = np.asarray(disturbance.values, dtype=np.float64)
    missing = ~np.isfinite(values)
    kept = spectral.inside(disturbance, missing, edge)
    filled = np.where(missing, 0.0, values - (0.0 if of_vector else np.nanmean(values)))
    operators = [partial(operator, name, height) for name in components]
    taper = _VECTOR_TAPER if of_vector else _TENSOR_TAPER
    result = spectral.transformed(disturbance, filled, operators, taper)
    result[:, ~kept] = np.nan
    named = zip(components, result, strict=True)
    return ChannelMap([_channel(disturbance, name, one, height) for name, one in named], result)


def from_deflections(xi: FieldMap, eta: FieldMap) -> ChannelMap:
    """Return maps of the attraction to the north and to the east, m/s², from those of the
    deflection of the vertical to the north (xi) and to the east (eta), rad.

    Raises
    ------
    InputError
        Other quantities, or different grids.
    """
    channels = []
    for map_, named, quantity in zip(
        (xi, eta), ("deflection_north", "deflection_east"), VECTOR[1:], strict=True
    ):
        if map_.quantity != named:
            raise InputError(
                f"{map_.provenance or 'map'}: must be a map of {named}, is one of {map_.quantity}"
            )
        gamma = normal_gravity(map_.latitude, map_.height or 0.0)[:, None]
        mean = float(gamma.mean())
        of_map = replace(map_, unit="m/s²", file_unit="m/s²", file_factor=1.0, quantity=quantity)
        channels.append(
            replace(
                of_map,
                values=-gamma * map_.values,
                sigma=map_.sigma * (gamma if np.ndim(map_.sigma) else mean),
                quantisation=map_.quantisation * mean,
            )
        )
    return ChannelMap(channels)


def operator(component: str, height: float, waves: Waves) -> Spectrum:
    """Return what the transform of a map of the disturbance is to be multiplied by, to be that of
    a component, of `VECTOR` or `COMPONENTS`, at a height (m) above it."""
    decay = np.exp(-waves.size * height)
    if component == "disturbance":
        return decay
    # a disturbance that is the same everywhere pulls to no side, and has no gradient
    k = np.where(waves.size > 0.0, waves.size, 1.0)
    north, east = waves.odd_north, waves.odd_east
    slopes = {"nd": north, "ed": east, "gravity_north": north / k, "gravity_east": east / k}
    if component in slopes:
        return np.asarray(1j * slopes[component] * decay, dtype=np.complex128)
    products = {
        "nn": -(waves.north**2),
        "ne": -north * east,
        "ee": -(waves.east**2),
        "dd": waves.north**2 + waves.east**2,
    }
    return products[component] / k * decay


def _channel(disturbance: FieldMap, component: str, values: Array, height: float) -> FieldMap:
    """Return the map of a component, with what becomes of the map's errors."""
    of_tensor = component in COMPONENTS
    # half of the variance of the disturbance goes into each horizontal component
    share = float(shares((component,))[0]) if of_tensor else 0.5
    root = math.sqrt(1.0 if component == "disturbance" else share)

    def factor(wavenumber: Array) -> Array:
        """Return the root mean square of `operator` over all directions."""
        return np.asarray(root * np.exp(-wavenumber * height) * wavenumber**of_tensor)

    spectrum, unit = ErrorSpectrum.of_map(disturbance), "1/s²" if of_tensor else "m/s²"
    above = None if of_tensor or disturbance.height is None else disturbance.height + height
    name = f"T_{component}" if of_tensor else component
    return FieldMap(
        disturbance.latitude,
        disturbance.longitude,
        values,
        unit=unit,
        quantity="gradient" if of_tensor else component,
        sigma=spectrum.sigma * spectrum.gain(factor),
        correlation_length=replace(spectrum, rounding=0.0).length(factor),
        quantisation=disturbance.quantisation * spectrum.white_gain(factor),
        provenance=f"{name} of {disturbance.provenance or 'map'}",
        file_unit=unit,
        error_stated=disturbance.states_error,
        height=above,
    )
