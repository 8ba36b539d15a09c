"""Fourier transforms of a map over a plane: wavenumbers, operators, edges. What becomes of the
map's errors is in `isogal.maps.error_spectrum`.

A map is a few hundred km wide at most, where a plane errs by far less than such fields are known.
That a degree of longitude gets shorter towards the pole is allowed for by computing with the scale
of several latitudes and interpolating."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap

Real = TypeVar("Real", np.float32, np.float64)
STRETCH = 0.01
"""Share by which the length of a degree of longitude may differ between the latitudes computed
with."""
_WIDEST = 0.2
"""Share by which it may differ over the whole map."""
MOST_MISSING = 0.2
"""Share of a map that may be missing."""


class Waves(NamedTuple):
    """Wavenumbers (rad/m) of the real transform of a map."""

    north: Array
    """(n, 1)"""
    east: Array
    """(1, m // 2 + 1)"""
    size: Array
    """(n, m // 2 + 1), |k|."""
    odd_north: Array
    """`north`, zero at the highest wavenumber of an even grid: of that the grid only has the
    cosine, whose derivative it cannot show."""
    odd_east: Array
    """`east`, likewise."""


Spectrum = NDArray[np.complex128] | Array
"""Of a map, or what one is multiplied by, (n, m // 2 + 1)."""
Operator = Callable[[Waves], Spectrum]
"""What the transform of a map is multiplied by, from the wavenumbers."""


def waves_of(shape: tuple[int, int], cell: tuple[float, float]) -> Waves:
    """Return the wavenumbers of maps of a shape (n, m) with cells (north, east), m."""
    k_n: Array = 2.0 * np.pi * np.fft.fftfreq(shape[0], cell[0])[:, None].astype(np.float64)
    k_e: Array = 2.0 * np.pi * np.fft.rfftfreq(shape[1], cell[1])[None, :].astype(np.float64)
    odd_n, odd_e = k_n.copy(), k_e.copy()
    if shape[0] % 2 == 0:
        odd_n[shape[0] // 2] = 0.0
    if shape[1] % 2 == 0:
        odd_e[:, -1] = 0.0
    return Waves(k_n, k_e, np.hypot(k_n, k_e), odd_n, odd_e)


def check_plane(field_map: FieldMap, what: str) -> None:
    """Raise InputError unless a map can be transformed: few holes, and not too far north-south.

    `what` names the result, for the message."""
    where = field_map.provenance or "map"
    if (share := float(np.mean(~np.isfinite(field_map.values)))) > MOST_MISSING:
        raise InputError(
            f"{where}: {100.0 * share:.0f} % of the map is missing; {what} need a map without"
            " holes"
        )
    east = metres_per_radian(field_map.latitude)[1]
    if abs(east[0] - east[-1]) > _WIDEST * float(east.mean()):
        raise InputError(
            f"{where}: the map reaches too far north-south for a plane; cut a window of a few"
            " degrees"
        )


def reference_latitudes(
    latitude: Array, stretch: float = STRETCH
) -> Iterator[tuple[float, Array]]:
    """Yield latitudes (rad) to compute with and the weight (n,) that each has at the map's
    rows."""
    east = metres_per_radian(latitude)[1]
    count = 1 + math.ceil(abs(float(east[0] - east[-1])) / (stretch * float(east.mean())))
    if count == 1:
        yield float(latitude.mean()), np.ones(latitude.size)
        return
    places = np.linspace(latitude[0], latitude[-1], count)
    step = places[1] - places[0]
    for place in places:
        yield float(place), np.maximum(0.0, 1.0 - np.abs(latitude - place) / step)


def transformed(
    field_map: FieldMap,
    values: Array,
    operators: Iterable[Operator],
    taper: float,
    *,
    antisymmetric: bool = False,
) -> Array:
    """Apply operators to values on the grid of a map.

    Parameters
    ----------
    field_map : FieldMap
        Whose grid it is.
    values : (n, m)
        Without holes; taken to fade to zero beyond the map.
    operators : P operators
    taper : float
        m over which the continuation beyond the map fades out.
    antisymmetric : bool
        See `continued`.

    Returns
    -------
    (P, n, m)
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    chosen = tuple(operators)
    n, m = values.shape
    result = np.zeros((len(chosen), n, m))
    for latitude, weight in reference_latitudes(field_map.latitude):
        cell = field_map.cell[0], field_map.cell_size_m(latitude)[1]
        pads = padding((n, m), cell, taper)
        # more than a small map's mirror images
        rooms = [max(pad, math.ceil(taper / size)) for pad, size in zip(pads, cell, strict=True)]
        shape = (
            next_fast_len(n + 2 * rooms[0], real=True),
            next_fast_len(m + 2 * rooms[1], real=True),
        )
        spectrum = rfft2(continued(values, pads, antisymmetric=antisymmetric), shape)
        waves = waves_of(shape, cell)
        for index, operator in enumerate(chosen):
            whole = irfft2(spectrum * operator(waves), shape)
            result[index] += weight[:, None] * whole[pads[0] : pads[0] + n, pads[1] : pads[1] + m]
    return result


def padding(shape: tuple[int, int], cell: tuple[float, float], taper: float) -> list[int]:
    """Return by how many nodes a map is continued on each side, along both axes; a mirror image
    cannot be wider than the map."""
    return [
        min(max(math.ceil(taper / size), 1), count - 1)
        for size, count in zip(cell, shape, strict=True)
    ]


def continued(
    values: NDArray[Real], pads: list[int], *, antisymmetric: bool = False
) -> NDArray[Real]:
    """Continue a map by its mirror image on all sides, faded out by a cosine.

    Antisymmetric: mirrored in the value at the rim, too, so that the slope goes on; of fields with
    long waves that is the better guess."""
    around = [(pad, pad) for pad in pads]
    kind: Literal["odd", "even"] = "odd" if antisymmetric else "even"
    mirrored = np.pad(values, around, mode="reflect", reflect_type=kind)
    extended = np.asarray(mirrored, dtype=values.dtype)
    for axis, pad in enumerate(pads):
        fade = 0.5 - 0.5 * np.cos(np.pi * (np.arange(pad) + 0.5) / pad)
        weight = np.ones(extended.shape[axis], dtype=values.dtype)
        weight[:pad], weight[-pad:] = fade, fade[::-1]
        extended = extended * (weight[:, None] if axis == 0 else weight)
    return extended


def rim_distance(missing: Booleans, field_map: FieldMap) -> Array:
    """Return (n, m) how far each node lies from the map's end or a hole, m; zero in a hole."""
    from scipy.ndimage import distance_transform_edt

    around = np.pad(~missing, 1, constant_values=False)
    size = field_map.cell
    return np.asarray(distance_transform_edt(around, sampling=size)[1:-1, 1:-1])


def inside(field_map: FieldMap, missing: Booleans, edge: float) -> Booleans:
    """Return (n, m) which nodes lie farther than `edge` (m) from the map's end and from holes.

    Raises
    ------
    InputError
        No node does.
    """
    kept = rim_distance(missing, field_map) > edge
    if not kept.any():
        raise InputError(
            f"{field_map.provenance or 'map'}: nothing is left of the map within"
            f" {edge / 1000.0:g} km of its edges and holes"
        )
    return np.asarray(kept)
