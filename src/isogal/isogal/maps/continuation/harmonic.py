"""Which fields can be continued, and what the ways to do it share.

A field that is harmonic above its sources (the gravity disturbance, each component of the
gradient tensor, the magnetic anomaly as long as the direction of the main field changes little)
decays upwards by exp(-|k| h) at the wavenumber k (Blakely 1995, Potential Theory in Gravity and
Magnetic Applications, chapter 12)."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Booleans, Values
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.field_map import FieldMap

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


def check(field_map: FieldMap, height: float, edge: float | None) -> None:
    """Raise InputError unless a map can be continued to a height (m) and its rim cut (m)."""
    if field_map.quantity not in FADING + OFFSET:
        reason = " (take the disturbance)" if field_map.quantity == "gravity" else ""
        raise InputError(
            f"{field_map.provenance or 'map'}: a map of {field_map.quantity} cannot be continued"
            f"{reason}; possible: {', '.join(FADING + OFFSET)}"
        )
    if not math.isfinite(height):
        raise InputError(f"height to continue to must be finite, is {height}")
    if edge is not None and not (math.isfinite(edge) and edge >= 0.0):
        raise InputError(f"edge of the continuation must be >= 0 m, is {edge}")
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
    """Return a map continued to a height (m): its values there, and 1-sigma and correlation length
    (m) of their errors."""
    sigma, length = errors
    origin = " from the ground" if from_ground else ""
    return replace(
        field_map,
        values=values,
        sigma=sigma,
        correlation_length=length,
        correlation_lengths=None,
        error_ellipses=None,
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
