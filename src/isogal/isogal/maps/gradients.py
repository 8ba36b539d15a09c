"""The gravity gradient tensor from a map of the gravity disturbance, by Fourier transform.

Over a plane the disturbing potential T outside the masses is harmonic, so each of its wavelengths
decays upwards as exp(-|k| h), and any derivative of T follows from any other (Blakely 1995,
Potential Theory in Gravity and Magnetic Applications, chapter 11). With the axes north, east,
down, k = (k_n, k_e) and the disturbance g = dT/d(down) of transform G:

    T_dd = |k| G,   T_nd = i k_n G,   T_ed = i k_e G,
    T_nn = -k_n²/|k| G,   T_ee = -k_e²/|k| G,   T_ne = -k_n k_e/|k| G

so that T_nn + T_ee + T_dd = 0: five components are independent. `isogal.maps.spectral` does the
transforms."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.channels import ChannelMap
from isogal.maps.error_spectrum import USUAL_LENGTH
from isogal.maps.field_map import FieldMap
from isogal.maps.spectral import Waves
from isogal.scenario import TENSOR_COMPONENTS

COMPONENTS = TENSOR_COMPONENTS
"""Second derivatives of the disturbing potential by north (n), east (e) and down (d)."""
TAPER = 20_000.0
"""m over which the continuation beyond the map fades out."""
INDEPENDENT = COMPONENTS[:5]
"""Five that say all: dd = -nn - ee."""


def tensor_maps(
    disturbance: FieldMap,
    components: tuple[str, ...] = INDEPENDENT,
    *,
    height: float = 0.0,
    edge: float = 20_000.0,
) -> ChannelMap:
    """Return maps of components of the gradient tensor, one channel each, in 1/s² (1 E = 1e-9
    1/s²).

    What the map says of its errors goes through the same transform: its sigma, as of a field with
    covariance sigma² exp(-d / L), and its step of values, as white noise of the nodes, become
    sigma and step of each channel. The errors of a gradient hold together over a cell or the
    height, whichever is larger, and not over L: each channel has a correlation length of its own.

    Edges: what lies beyond the map is unknown. The map's mean is taken off, the map continued by
    its mirror image, and the continuation faded out by a cosine over `TAPER`. What the unknown
    outside changes is largest at the rim, where the result is left out over `edge`.

    Parameters
    ----------
    disturbance : FieldMap
        Gravity disturbance, m/s², without holes (small ones are filled, and the result is left out
        there).
    components : tuple of str
        Of `COMPONENTS`.
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
    spectral.check_disturbance(disturbance, "gradients", height=height, edge=edge)
    unknown = [name for name in components if name not in COMPONENTS]
    if unknown or not components:
        raise InputError(
            f"unknown tensor component {', '.join(unknown) or '(none)'}; known:"
            f" {', '.join(COMPONENTS)}"
        )
    values = np.asarray(disturbance.values, dtype=np.float64)
    missing = ~np.isfinite(values)
    filled = np.where(missing, 0.0, values - np.nanmean(values))
    operators = [partial(_operator, name, height) for name in components]
    result = spectral.transformed(disturbance, filled, operators, TAPER)
    kept = spectral.inside(disturbance, missing, edge)
    channels = []
    for name, component in zip(components, result, strict=True):
        component[~kept] = np.nan
        channels.append(_channel(disturbance, name, component, height))
    return ChannelMap(channels)


def _channel(disturbance: FieldMap, name: str, values: Array, height: float) -> FieldMap:
    """Return the map of one component, with what becomes of the errors of the disturbance."""
    sigma = float(np.sqrt(np.nanmean(np.square(disturbance.sigma))))
    step = disturbance.quantisation
    length = disturbance.correlation_length or USUAL_LENGTH
    cell = disturbance.cell
    return FieldMap(
        disturbance.latitude,
        disturbance.longitude,
        values,
        unit="1/s²",
        quantity="gradient",
        sigma=sigma and sigma * error_gain(name, cell, height, length),
        correlation_length=error_length(name, cell, height, length) if sigma else None,
        quantisation=step and step * error_gain(name, cell, height),
        provenance=f"T_{name} of {disturbance.provenance or 'map'}",
        file_unit="1/s²",
        error_stated=disturbance.states_error,
    )


def _operator(component: str, height: float, waves: Waves) -> NDArray[Any]:
    """Return what the transform of a map of the disturbance is to be multiplied by."""
    decay = np.exp(-waves.size * height)
    k = waves.size.copy()
    k[0, 0] = 1.0  # the mean has been taken off
    if component in ("nd", "ed"):
        return 1j * (waves.odd_north if component == "nd" else waves.odd_east) * decay
    products = {
        "nn": -(waves.north**2),
        "ne": -waves.odd_north * waves.odd_east,
        "ee": -(waves.east**2),
        "dd": waves.north**2 + waves.east**2,
    }
    return products[component] / k * decay


def error_gain(
    component: str, cell: tuple[float, float], height: float, length: float | None = None
) -> float:
    """Return how many 1/s² of error a component gets from 1 m/s² of error of the disturbance
    (1-sigma each), see `isogal.maps.spectral.error_gain`."""
    return spectral.error_gain(partial(_operator, component, height), cell, length)


def error_length(component: str, cell: tuple[float, float], height: float, length: float) -> float:
    """Return the correlation length (m) of a component's error, see
    `isogal.maps.spectral.error_length`."""
    return spectral.error_length(partial(_operator, component, height), cell, length)
