"""The gravity gradient tensor from a map of the gravity disturbance, by Fourier transform.

Over a plane the disturbing potential T outside the masses is harmonic, so each of its wavelengths
decays upwards as exp(-|k| h), and any derivative of T follows from any other (Blakely 1995,
Potential Theory in Gravity and Magnetic Applications, chapter 11). With the axes north, east,
down, k = (k_n, k_e) and the disturbance g = dT/d(down) of transform G:

    T_dd = |k| G,   T_nd = i k_n G,   T_ed = i k_e G,   T_nn = -k_n²/|k| G,   T_ee = -k_e²/|k| G,   T_ne = -k_n k_e/|k| G

so that T_nn + T_ee + T_dd = 0: five components are independent. The map is a few hundred km wide
at most, where the plane errs by far less than gradients are known; that a degree of longitude gets
shorter towards the pole is allowed for by computing with the scale of several latitudes and
interpolating."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.scenario import TENSOR_COMPONENTS

COMPONENTS = TENSOR_COMPONENTS
"""Second derivatives of the disturbing potential by north (n), east (e) and down (d)."""
INDEPENDENT = COMPONENTS[:5]
"""Five that say all: dd = -nn - ee."""
USUAL_LENGTH = 4000.0
"""m, correlation length of a disturbance map's error where the map does not say it (the scenario's
default)."""
_STRETCH = 0.01
"""Share by which the length of a degree of longitude may differ between the latitudes computed
with."""
_WIDEST = 0.2
"""Share by which it may differ over the whole map."""
_MOST_MISSING = 0.2


def tensor_maps(
    disturbance: FieldMap,
    components: tuple[str, ...] = INDEPENDENT,
    *,
    height: float = 0.0,
    taper: float = 20_000.0,
    edge: float = 20_000.0,
) -> ChannelMap:
    """Return maps of components of the gradient tensor, one channel each, in 1/s² (1 E = 1e-9
    1/s²).

    What the map says of its errors goes through the same transform: its sigma, as of a field with
    covariance sigma² exp(-d / L), and its step of values, as white noise of the nodes, become
    sigma and step of each channel. The errors of a gradient hold together over a cell or the
    height, whichever is larger, and not over L: each channel has a correlation length of its own.

    Edges: what lies beyond the map is unknown. The map's mean is taken off, the map continued by
    its mirror image, and the continuation faded out by a cosine over `taper`. What the unknown
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
    taper, edge : float
        m.

    Raises
    ------
    InputError
        Not a map of the disturbance, unknown component, negative height, too many holes, too small
        or too large a map.
    """
    where = disturbance.provenance or "map"
    _check(disturbance, components, height, taper, edge, where)
    rows_m, _ = disturbance.cell_size_m(float(disturbance.latitude.mean()))
    values = np.asarray(disturbance.values, dtype=np.float64)
    missing = ~np.isfinite(values)
    filled = np.where(missing, 0.0, values - np.nanmean(values))
    result = np.zeros((len(components), *values.shape))
    for latitude, weight in _reference_latitudes(disturbance.latitude):
        _, columns_m = disturbance.cell_size_m(latitude)
        for i, component in enumerate(
            _components(filled, rows_m, columns_m, components, height, taper)
        ):
            result[i] += weight[:, None] * component
    sigma = float(np.sqrt(np.nanmean(np.square(disturbance.sigma))))
    length = disturbance.correlation_length or USUAL_LENGTH
    cell = disturbance.cell_size_m(float(disturbance.latitude.mean()))
    cut = _rim(missing, disturbance, edge)
    if not (~cut).any():
        raise InputError(
            f"{where}: nothing is left of the map within {edge / 1000.0:g} km of its edges and"
            " holes"
        )
    channels = []
    for name, component in zip(components, result, strict=True):
        component[cut] = np.nan
        channels.append(
            FieldMap(
                disturbance.latitude,
                disturbance.longitude,
                component,
                unit="1/s²",
                quantity="gradient",
                sigma=sigma and sigma * error_gain(name, cell, height, length),
                correlation_length=error_length(name, cell, height, length) if sigma else None,
                quantisation=disturbance.quantisation
                and disturbance.quantisation * error_gain(name, cell, height),
                provenance=f"T_{name} of {where}",
                file_unit="1/s²",
            )
        )
    return ChannelMap(channels)


def _check(
    disturbance: FieldMap,
    components: tuple[str, ...],
    height: float,
    taper: float,
    edge: float,
    where: str,
) -> None:
    if disturbance.quantity != "disturbance":
        raise InputError(
            f"{where}: gradients come from a map of the disturbance, not of {disturbance.quantity}"
        )
    unknown = [name for name in components if name not in COMPONENTS]
    if unknown or not components:
        raise InputError(
            f"unknown tensor component {', '.join(unknown) or '(none)'}; known:"
            f" {', '.join(COMPONENTS)}"
        )
    for name, value in (("height", height), ("taper", taper), ("edge", edge)):
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"{name} of the gradients must be >= 0 m, is {value}")
    share = float(np.mean(~np.isfinite(disturbance.values)))
    if share > _MOST_MISSING:
        raise InputError(
            f"{where}: {100.0 * share:.0f} % of the map is missing; gradients need a map without"
            " holes"
        )
    east = metres_per_radian(disturbance.latitude)[1]
    if abs(east[0] - east[-1]) > _WIDEST * float(east.mean()):
        raise InputError(
            f"{where}: the map reaches too far north-south for a plane; cut a window of a few"
            " degrees"
        )


def _reference_latitudes(latitude: Array) -> Iterator[tuple[float, Array]]:
    """Yield latitudes to compute with and the weight (n,) that each has at the map's rows."""
    east = metres_per_radian(latitude)[1]
    count = 1 + math.ceil(abs(float(east[0] - east[-1])) / (_STRETCH * float(east.mean())))
    if count == 1:
        yield float(latitude.mean()), np.ones(latitude.size)
        return
    places = np.linspace(latitude[0], latitude[-1], count)
    step = places[1] - places[0]
    for place in places:
        yield float(place), np.maximum(0.0, 1.0 - np.abs(latitude - place) / step)


def _components(
    values: Array,
    rows_m: float,
    columns_m: float,
    components: tuple[str, ...],
    height: float,
    taper: float,
) -> Iterator[Array]:
    """Yield components (n, m) of a map on a plane whose cells are rows_m x columns_m."""
    from scipy.fft import irfft2, next_fast_len, rfft2

    n, m = values.shape
    pads = [
        min(max(math.ceil(taper / size), 1), count - 1)
        for size, count in ((rows_m, n), (columns_m, m))
    ]
    shape = tuple(
        next_fast_len(count + 2 * pad, real=True) for count, pad in zip((n, m), pads, strict=True)
    )
    extended = _continued(values, pads)
    spectrum = rfft2(extended, shape)
    for name in components:
        whole = irfft2(spectrum * _operator(name, shape, rows_m, columns_m, height), shape)
        yield whole[pads[0] : pads[0] + n, pads[1] : pads[1] + m]


def _operator(
    component: str, shape: tuple[int, int], rows_m: float, columns_m: float, height: float
) -> NDArray[Any]:
    """Return what the real transform of a map of that shape is to be multiplied by."""
    k_n = 2.0 * np.pi * np.fft.fftfreq(shape[0], rows_m)[:, None]
    k_e = 2.0 * np.pi * np.fft.rfftfreq(shape[1], columns_m)[None, :]
    k = np.hypot(k_n, k_e)
    decay = np.exp(-k * height)
    k[0, 0] = 1.0  # the mean has been taken off
    # of the highest wavenumber an even grid only has the cosine, whose derivative it cannot show
    odd_n, odd_e = k_n.copy(), k_e.copy()
    if shape[0] % 2 == 0:
        odd_n[shape[0] // 2] = 0.0
    if shape[1] % 2 == 0:
        odd_e[:, -1] = 0.0
    if component in ("nd", "ed"):
        return 1j * (odd_n if component == "nd" else odd_e) * decay
    products = {"nn": -(k_n**2), "ne": -odd_n * odd_e, "ee": -(k_e**2), "dd": k_n**2 + k_e**2}
    return products[component] / k * decay


def error_gain(
    component: str, cell: tuple[float, float], height: float, length: float | None = None
) -> float:
    """Return how many 1/s² of error a component gets from 1 m/s² of error of the disturbance
    (1-sigma each).

    The mean of the squared operator over all wavenumbers that the grid can show, weighted by the
    error's spectrum.

    Parameters
    ----------
    cell : (float, float)
        Of the grid, to the north and to the east, m.
    height : float
        m.
    length : float, optional
        L of the errors' covariance exp(-d / L) between nodes, m; None = white noise of the nodes.
    """
    weight = _error_spectrum(cell, length)
    power = np.abs(_operator(component, _TORUS, *cell, height)) ** 2
    weight[:, [0, -1]] *= 0.5  # a real transform holds the other columns once for two
    return math.sqrt(float((weight * power).sum() / weight.sum()))


def error_length(component: str, cell: tuple[float, float], height: float, length: float) -> float:
    """Return the distance (m) at which a component's error has a correlation of 1/e, on the mean
    of all directions; see `error_gain`."""
    power = np.abs(_operator(component, _TORUS, *cell, height)) ** 2
    correlation = np.fft.irfft2(_error_spectrum(cell, length) * power, _TORUS)
    distance, step = _torus_distance(cell), max(cell)
    ring = np.rint(distance / step).astype(np.int64).ravel()
    mean = np.bincount(ring, correlation.ravel()) / np.bincount(ring) / correlation[0, 0]
    away = np.bincount(ring, distance.ravel()) / np.bincount(ring)
    first = int(np.argmax(mean < math.exp(-1.0)))
    return float(
        np.interp(-math.exp(-1.0), -mean[first - 1 : first + 1], away[first - 1 : first + 1])
    )


_TORUS = (256, 256)
"""Nodes of the made-up map whose spectrum is looked at."""


def _torus_distance(cell: tuple[float, float]) -> Array:
    north, east = (
        size * count * np.abs(np.fft.fftfreq(count))
        for size, count in zip(cell, _TORUS, strict=True)
    )
    return np.asarray(np.hypot(north[:, None], east))


def _error_spectrum(cell: tuple[float, float], length: float | None) -> Array:
    """Return the power of errors of the disturbance at each wavenumber of a real transform, in any
    unit."""
    if length is None:
        return np.ones((_TORUS[0], _TORUS[1] // 2 + 1))
    return np.maximum(np.fft.rfft2(np.exp(-_torus_distance(cell) / length)).real, 0.0)


def _continued(values: Array, pads: list[int]) -> Array:
    """Continue a map by its mirror image on all sides, faded out by a cosine."""
    extended = np.pad(values, [(pad, pad) for pad in pads], mode="reflect")
    for axis, pad in enumerate(pads):
        fade = 0.5 - 0.5 * np.cos(np.pi * (np.arange(pad) + 0.5) / pad)
        weight = np.ones(extended.shape[axis])
        weight[:pad], weight[-pad:] = fade, fade[::-1]
        extended *= weight[:, None] if axis == 0 else weight
    return extended


def _rim(missing: Booleans, field_map: FieldMap, edge: float) -> Booleans:
    """Return (n, m) which nodes lie within `edge` (m) of the map's end or of a hole."""
    from scipy.ndimage import distance_transform_edt

    around = np.pad(~missing, 1, constant_values=False)
    size = field_map.cell_size_m(float(field_map.latitude.mean()))
    return np.asarray(distance_transform_edt(around, sampling=size)[1:-1, 1:-1] <= edge)
