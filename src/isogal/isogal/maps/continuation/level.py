"""From one level to another, and what all ways of continuation share.

A field that is harmonic above its sources (the gravity disturbance, each component of the
gradient tensor, the magnetic anomaly as long as the direction of the main field changes little)
decays upwards by exp(-|k| h) at the wavenumber k (Blakely 1995, Potential Theory in Gravity and
Magnetic Applications, chapter 12). Over a plane that is exact. Downwards the same
factor grows without bound towards short waves, and with it whatever is wrong about them: that is
only done with a cut-off wavelength. Waves shorter than it are left out, those longer than 4/3 of
it kept, with a cosine between."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Booleans, Values
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.error_spectrum import ErrorSpectrum, Factor, mixed_length
from isogal.maps.field_map import FieldMap
from isogal.maps.spectral import Operator

FADING = (
    "disturbance",
    "gravity_anomaly",
    "magnetic_anomaly",
    "gradient",
    "gravity_north",
    "gravity_east",
    "deflection_north",
    "deflection_east",
)
"""Quantities that are taken to be zero far beyond the map."""
OFFSET = ("bouguer_disturbance", "bouguer_anomaly")
"""Quantities whose level is a matter of their reduction: taken to have the map's mean there."""
TAPER = 20_000.0
"""m over which the continuation beyond the map fades out; measured, see docs/maps.md."""
EDGE = 5.0
"""Rim that is left out unless said otherwise, in heights of continuation."""
_KEPT = 0.75
"""Share of the cut-off's wavenumber up to which everything is kept."""


def to_level(
    field_map: FieldMap,
    height: float,
    from_height: float | None = None,
    *,
    cutoff: float | None = None,
    edge: float | None = None,
) -> FieldMap:
    """Continue a map from the level that its values hold on to another.

    The map's own error and the rounding of its values go through the same operator and become
    sigma and correlation length of the result (`isogal.maps.error_spectrum`). Downwards sigma also
    holds what the cut-off leaves out: the shorter waves of the map, with the factor that they have
    at the cut-off.

    Parameters
    ----------
    field_map : FieldMap
        Of a harmonic quantity, without large holes (small ones are filled, and the result is left
        out there); rows and columns at its ends without any value are cut off. The channels of a
        vector map are continued one by one.
    height : float
        m above the ellipsoid.
    from_height : float, optional
        m above the ellipsoid; None = as the map says.
    cutoff : float, optional
        Wavelength, m; needed downwards, and only there.
    edge : float, optional
        m at the rim and round holes that are left out; None = five times the way up or down.

    Raises
    ------
    InputError
        Not a harmonic quantity, unknown height, no cut-off downwards, too many holes, bad size.
    """
    field_map, where = trimmed(field_map), field_map.provenance or "map"
    check(field_map)
    start = field_map.height if from_height is None else from_height
    if start is None:
        raise InputError(
            f"{where}: does not say at which height its values hold; give from_height"
            " (--from-height), or the terrain (--terrain) for values on the ground"
        )
    rise = height - start
    _check_cutoff(field_map, rise, cutoff, where)
    missing = ~np.isfinite(field_map.values)
    kept = spectral.inside(field_map, missing, EDGE * abs(rise) if edge is None else edge)
    values, offset = filled(field_map, missing)
    highest = math.inf if cutoff is None else 2.0 * math.pi / cutoff
    passed, factor = _factors(rise, highest)
    operators: list[Operator] = [lambda waves: factor(waves.size)]
    if cutoff is not None:
        operators.append(lambda waves: 1.0 - passed(waves.size))
    result = spectral.transformed(field_map, values, operators, TAPER, antisymmetric=True)
    left_out = 0.0
    if cutoff is not None:
        left_out = math.exp(-rise * highest) * float(np.sqrt(np.mean(result[1, kept] ** 2)))
    errors = _error(field_map, factor, left_out, 1.0 / highest)
    values = np.where(kept, result[0] + offset, np.nan)
    return at_level(field_map, values, errors, height)


def _factors(rise: float, highest: float) -> tuple[Factor, Factor]:
    """Return the share of each wave that is kept below a highest wavenumber (rad/m), and the
    factor of the continuation."""

    def passed(wavenumber: Array) -> Array:
        place = np.clip((wavenumber / highest - _KEPT) / (1.0 - _KEPT), 0.0, 1.0)
        return np.asarray(0.5 + 0.5 * np.cos(math.pi * place))

    def factor(wavenumber: Array) -> Array:
        return np.asarray(np.exp(-rise * np.minimum(wavenumber, highest)) * passed(wavenumber))

    return passed, factor


def _check_cutoff(field_map: FieldMap, rise: float, cutoff: float | None, where: str) -> None:
    """Raise InputError unless a cut-off wavelength (m) fits the way up or down (m)."""
    cell = field_map.cell
    if rise >= 0.0 and cutoff is not None:
        raise InputError(
            f"{where}: a cut-off wavelength is for downward continuation, this is {rise:g} m"
            " upwards"
        )
    if rise < 0.0 and cutoff is None:
        growth = math.exp(min(-rise * math.pi / max(cell), 700.0))
        raise InputError(
            f"{where}: {-rise:g} m down the shortest waves of the map grow {growth:.3g} times, and"
            " their errors with them; give a cut-off wavelength (--downward-cutoff, km)"
        )
    width = min(size * count for size, count in zip(cell, field_map.shape, strict=True))
    if cutoff is not None and not 2.0 * max(cell) <= cutoff <= width:
        raise InputError(
            f"{where}: the cut-off wavelength must be {2e-3 * max(cell):.3g} (two cells) to"
            f" {1e-3 * width:.3g} km (the map), is {1e-3 * cutoff:g}"
        )


def _error(
    field_map: FieldMap, factor: Factor, left_out: float, length: float
) -> tuple[float | Array, float | None]:
    """Return sigma and correlation length (m) of the result, from the factor of the continuation,
    and 1-sigma and length (m) of the waves beyond the cut-off."""
    spectrum = ErrorSpectrum.of_map(field_map)
    gain = spectrum.gain(factor)
    steps = spectrum.rounding * spectrum.white_gain(factor)
    parts = [
        (left_out**2, length),
        ((spectrum.sigma * gain) ** 2 + steps**2, spectrum.length(factor)),
    ]
    total = np.sqrt(np.square(field_map.sigma * gain) + steps**2 + left_out**2)
    return total if np.ndim(total) else float(total), mixed_length(parts)


def check(field_map: FieldMap) -> None:
    """Raise InputError unless a map can be continued."""
    if field_map.quantity not in FADING + OFFSET:
        reason = " (take the disturbance)" if field_map.quantity == "gravity" else ""
        raise InputError(
            f"{field_map.provenance or 'map'}: a map of {field_map.quantity} cannot be continued"
            f"{reason}; possible: {', '.join(FADING + OFFSET)}"
        )
    spectral.check_plane(field_map, "continuations")


def trimmed(field_map: FieldMap) -> FieldMap:
    """Return a map without the rows and columns at its ends that have no value at all, such as the
    rim that an earlier transform has left out."""
    known = np.isfinite(field_map.values)
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    return field_map.part(slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))


def at_level(
    field_map: FieldMap,
    values: Values,
    errors: tuple[float | Array, float | None],
    height: float,
    from_ground: bool = False,
) -> FieldMap:
    """Return a map that has been continued.

    Parameters
    ----------
    field_map : FieldMap
        As it was.
    values : (n, m) array
        Of the result.
    errors : (float or (n, m) array, float or None)
        1-sigma and correlation length (m) of the result's errors.
    height : float
        m above the ellipsoid, of the result.
    from_ground : bool
        Whether the values were on the ground, for the provenance.
    """
    sigma, length = errors
    origin = " from the ground" if from_ground else ""
    return replace(
        field_map,
        values=values,
        sigma=sigma,
        correlation_length=length,
        error_ellipses=None,
        unresolved=0.0,
        error_stated=field_map.states_error,
        quantisation=0.0,
        provenance=f"{field_map.provenance or 'map'} continued{origin} to {height:g} m",
        height=height,
    )


def filled(field_map: FieldMap, missing: Booleans) -> tuple[Array, float]:
    """Return the values (n, m), less what they are far away and zero where missing, and what that
    is."""
    values = np.asarray(field_map.values, dtype=np.float64)
    offset = float(np.mean(values[~missing])) if field_map.quantity in OFFSET else 0.0
    return np.where(missing, 0.0, values - offset), offset
