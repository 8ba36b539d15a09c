"""From the ground to a level.

Values on the ground, as those of GGMplus, are not on a level. Sources below the ground are found
that make them (`isogal.maps.continuation.source_layer`); the field of these at the level is the
result. Nodes below the ground have no value."""

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.continuation.level import EDGE, TAPER, at_level, check, filled, trimmed
from isogal.maps.continuation.source_layer import Scale, SourceLayer
from isogal.maps.error_spectrum import ErrorSpectrum, mixed_length, upward
from isogal.maps.field_map import FieldMap

_STRETCH = 0.08
"""Share by which the length of a degree of longitude may differ between the latitudes computed
with: linear interpolation between them errs by less than 0.05 % of any wave."""
_RISES = 40
"""Heights above the ground for which the gain of errors is computed."""
_STEPS = 6
"""Heights above the ground that what is left unexplained is continued to."""


def from_terrain(
    field_map: FieldMap, terrain: FieldMap, height: float, *, edge: float | None = None
) -> FieldMap:
    """Continue a map whose values hold on the ground to a level.

    Sigma of each node is, in quadrature, that of the map and of the rounding of its values,
    and the root mean square around the node of what the sources leave unexplained, both continued
    upwards by as much as the node lies above the ground.

    Parameters
    ----------
    field_map : FieldMap
        Of a harmonic quantity, without large holes (small ones are filled, and the result is left
        out there); rows and columns at its ends without any value are cut off.
    terrain : FieldMap
        Height of the ground, m; on any grid that covers the map.
    height : float
        m, above the same surface as the terrain's heights.
    edge : float, optional
        m at the rim and round holes that are left out; None = five times the median height above
        the ground.

    Raises
    ------
    InputError
        Not a harmonic quantity, not a map of heights, a level below the ground, too many holes,
        too small or too large a map.
    """
    field_map, where = trimmed(field_map), field_map.provenance or "map"
    check(field_map)
    ground = _on_grid_of(field_map, terrain)
    missing, rise = ~(np.isfinite(field_map.values) & np.isfinite(ground)), height - ground
    if (share := float(np.mean(missing))) > spectral.MOST_MISSING:
        raise InputError(
            f"{where}: on {100.0 * share:.0f} % of the map either its value or the height of the"
            " terrain is missing"
        )
    above = rise[~missing & (rise >= 0.0)]
    if not above.size:
        raise InputError(f"{where}: {height:g} m is below the ground everywhere")
    typical = float(np.median(above))
    kept = spectral.inside(field_map, missing, EDGE * typical if edge is None else edge)
    values, offset = filled(field_map, missing)
    ground[missing] = np.median(ground[~missing])
    result, rest = _continued(field_map, values, ground, height)
    rest[missing] = 0.0
    errors = _error(field_map, np.maximum(rise, 0.0), rest, typical)
    result += offset
    result[~kept | ~(rise >= 0.0)] = np.nan
    if not np.isfinite(result).any():
        raise InputError(f"{where}: within the map's edges {height:g} m is below the ground")
    return at_level(field_map, result, errors, height, from_ground=True)


def _on_grid_of(field_map: FieldMap, terrain: FieldMap) -> Array:
    """Return the heights (n, m) at the nodes of a map; NaN where the terrain says nothing."""
    if terrain.quantity != "height":
        raise InputError(
            f"{terrain.provenance or 'terrain'}: must be a map of height, is one of"
            f" {terrain.quantity}"
        )
    if terrain.on_grid_of(field_map):
        return np.array(terrain.values, dtype=np.float64)
    ground = np.empty(field_map.values.shape)
    for row, latitude in zip(ground, field_map.latitude, strict=True):
        row[:] = terrain.value(latitude, field_map.longitude)
    return ground


def _continued(
    field_map: FieldMap, values: Array, ground: Array, height: float
) -> tuple[Array, Array]:
    """Return the field (n, m) at a height (m), and what of the values is left unexplained."""
    from scipy.fft import next_fast_len

    rows_m, columns_m = field_map.cell
    n, m = values.shape
    pads = spectral.padding((n, m), (rows_m, columns_m), TAPER)
    more = [
        next_fast_len(count + 2 * pad, real=True) - count - 2 * pad
        for count, pad in zip((n, m), pads, strict=True)
    ]
    mirrored = spectral.continued(values.astype(np.float32), pads)
    extended = np.pad(mirrored, [(0, count) for count in more])
    around = [(pad, pad + count) for pad, count in zip(pads, more, strict=True)]
    terrain = np.pad(ground.astype(np.float32), around, mode="reflect")
    scales = [
        Scale(
            field_map.cell_size_m(latitude)[1],
            np.pad(weight, around[0], mode="edge").astype(np.float32),
        )
        for latitude, weight in spectral.reference_latitudes(field_map.latitude, _STRETCH)
    ]
    layer = SourceLayer(terrain, rows_m, scales)
    middle = slice(pads[0], pads[0] + n), slice(pads[1], pads[1] + m)
    density, rest = layer.solve(np.asarray(extended, dtype=np.float32), middle)
    field = layer.field_at(density, height)
    return field[middle].astype(np.float64), rest[middle].astype(np.float64)


def _error(
    field_map: FieldMap, rise: Array, rest: Array, typical: float
) -> tuple[Array, float | None]:
    """Return sigma (n, m) and correlation length (m) at heights (n, m) above the ground, m, half
    of which are above `typical`, where `rest` (n, m) is left unexplained."""
    cell, spectrum = field_map.cell, ErrorSpectrum.of_map(field_map)
    steps = np.r_[0.0, np.geomspace(0.1 * min(cell), max(float(np.nanmax(rise)), cell[0]), _RISES)]
    decays = [upward(step) for step in steps]
    gain = np.interp(rise, steps, [spectrum.gain(decay) for decay in decays])
    white_gain = np.interp(rise, steps, [spectrum.white_gain(decay) for decay in decays])
    around = _unexplained(rest, rise, cell)
    total = (field_map.sigma * gain) ** 2 + (spectrum.rounding * white_gain) ** 2 + around
    length = spectrum.length(upward(typical))
    parts = [
        (float(np.mean(around)), 2.0 * max(*cell, typical)),
        (float(np.nanmean(total - around)), length),
    ]
    return np.sqrt(total), mixed_length(parts)


def _unexplained(rest: Array, rise: Array, cell: tuple[float, float]) -> Array:
    """Return the mean square (n, m) around each node of a rest (n, m) on the ground, continued
    upwards by a height (n, m), m, as over flat ground."""
    from scipy.fft import irfft2, rfft2
    from scipy.ndimage import gaussian_filter

    spectrum = rfft2(rest)
    size = spectral.waves_of((rest.shape[0], rest.shape[1]), cell).size
    steps = float(np.nanmax(rise)) * np.linspace(0.0, 1.0, _STEPS) ** 2
    around = np.zeros_like(rest)
    for i, step in enumerate(steps):
        higher = irfft2(spectrum * np.exp(-step * size), rest.shape)
        reach = [max(*cell, step) / one for one in cell]
        square = gaussian_filter(higher**2, reach, mode="nearest", truncate=3.0)
        around += square * np.interp(rise, steps, np.eye(_STEPS)[i])
    return around
