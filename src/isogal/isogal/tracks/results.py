"""Results of matching a track: in words, and as JSON, CSV and GeoJSON with one object for each
batch."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import csv_text, write_atomic
from isogal.matching.interfaces import Fix
from isogal.tracks.fields import TrackField, prefix
from isogal.tracks.matching import Match

Entry = dict[str, Any]
"""Of a batch, as JSON has it."""
FIX, NO_FIX = "fix", "no_fix"
_LENGTH = "map_correlation_length"
_ESTIMATES = ("map_sigma", _LENGTH, "offset", "offset_sigma")
HEADER = ("time (s)", "latitude", "longitude", "1-sigma (m)", "")
"""Of a table whose rows are `cells`."""
_NO_COVARIANCE = ((None, None), (None, None))
_DEGREE_DIGITS = 9
"""Decimals of degrees: 0.1 mm."""


def as_objects(matches: Sequence[Match], fields: Sequence[TrackField] = ()) -> list[Entry]:
    """Return one object for each batch: the line of the track's file if it has any, time s,
    latitude and longitude deg, covariance_enu m² (None = no fix), status, reason.

    Without a fix the position is that of the track. Objects also hold the position and its
    covariance with the prior (`with_prior_*`), of chained batches with all fixes so far
    (`aided_*`), and what was found of the fields' errors (`found`).
    """
    line = fields[0].track.line if fields else None
    begin = {} if line is None else {"line": line}
    objects = []
    for match in matches:
        fix = match.fix
        own = _place(fix.latitude, fix.longitude, fix.covariance if fix.published else None)
        known = _place(*match.position, match.covariance)
        status = {"status": FIX if fix.published else NO_FIX, "reason": fix.reason}
        result = {**begin, "time": fix.time, **own, **status}
        name = "aided" if match.chained else "with_prior"
        result |= {f"{name}_{key}": value for key, value in known.items()}
        objects.append(result | found(match, fields))
    return objects


def estimated(field: TrackField, fields: Sequence[TrackField]) -> str:
    """Return the key under which an object has what was estimated of a field's errors."""
    return "estimated" if field is fields[0] else f"{field.name}_estimated"


def found(match: Match, fields: Sequence[TrackField]) -> Entry:
    """Return what a batch has found of errors and readings, each field's in its own unit, lengths
    in m; nothing where noise was not integrated out."""
    numbers = match.fix.diagnostics
    if "readings_left_out" not in numbers or not fields:
        return {}
    result: Entry = {}
    for field in fields:
        begin = prefix(field, fields)
        if begin + "map_sigma" in numbers:
            units = dict.fromkeys(_ESTIMATES, field.track.factor) | {_LENGTH: 1.0}
            result[estimated(field, fields)] = {
                name: float(f"{numbers[begin + name] / unit:.4g}") for name, unit in units.items()
            }
    return result | {
        "readings": int(numbers["readings"]),
        "readings_left_out": int(numbers["readings_left_out"]),
        "misfit": round(numbers["misfit"], 3),
        "places": int(numbers["places"]),
        "probability": round(numbers["probability"], 4),
    }


def cells(fix: Fix) -> tuple[str, ...]:
    """Return the row of a fix in a table for people: place in deg, half-axes of its ellipse, or
    why there is none."""
    time = f"{fix.time:.10g}"
    if not fix.published:
        return time, "-", "-", "-", f"no fix: {fix.reason}"
    short, long = np.sqrt(np.linalg.eigvalsh(fix.covariance))
    place = (f"{math.degrees(angle):.5f}" for angle in (fix.latitude, fix.longitude))
    return time, *place, f"{long:.0f} x {short:.0f}", ""


def in_words(matches: Sequence[Match], fields: Sequence[TrackField]) -> list[str]:
    """Return how many batches gave a fix, and what was learnt of the errors of map and readings:
    of several batches the median."""
    fixes = [match.fix for match in matches]
    published, failed = sum(f.published for f in fixes), sum(f.failed for f in fixes)
    words = f"; the matcher failed on {failed} of them" if failed else ""
    batches = _counted(len(fixes), "batch", "batches")
    lines = [f"{_counted(published, 'fix', 'fixes')} of {batches}{words}"]
    each = [entry for one in matches if (entry := found(one, fields))]
    several = " (median of batches)" if len(each) > 1 else ""
    for field in fields:
        key = estimated(field, fields)
        if known := [list(entry[key].values()) for entry in each if key in entry]:
            sigma, length, offset, doubt = np.median(known, axis=0)
            of = "" if field is fields[0] else f" of {field.name}"
            lines.append(
                f"learnt{of}{several}: map error {sigma:.3g} {field.unit} over {length:.0f} m,"
                f" constant {offset:.3g} ± {doubt:.2g} {field.unit}"
            )
    if each:
        # those of a batch without fix are matched again with the next
        fixed = [found(one, fields) for one in matches if one.fix.published]
        used, out = (sum(one[key] for one in fixed) for key in ("readings", "readings_left_out"))
        misfit = np.median([one["misfit"] for one in each])
        lines.append(
            f"fixes: {used} readings used, {out} left out; squared residuals {misfit:.2f} of what"
            " is expected"
        )
    if published < len(fixes):
        lines.append(
            "no fix: longer batches (--batch-length all), tracks with true positions near by"
            " (--reference), or --map-sigma auto where another was given may help"
        )
    return lines


def _counted(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"


def _place(latitude: float, longitude: float, covariance: Array | None) -> Entry:
    """Return a place (rad) in deg with its covariance of north and east (first two rows and
    columns; None = there is none) in the order east, north."""
    turned = math.degrees(math.remainder(longitude, 2.0 * math.pi))
    enu = None if covariance is None else covariance[1::-1, 1::-1].tolist()
    return {
        "latitude": round(math.degrees(latitude), _DEGREE_DIGITS),
        "longitude": round(turned, _DEGREE_DIGITS),
        "covariance_enu": enu,
    }


def as_json(objects: Sequence[Entry]) -> str:
    """Return a JSON array with one object in each line."""
    lines = ",\n  ".join(json.dumps(item, allow_nan=False) for item in objects)
    return f"[\n  {lines}\n]\n" if objects else "[]\n"


def as_csv(objects: Sequence[Entry]) -> str:
    """Return a table with three columns for each covariance: east-east, east-north,
    north-north."""
    return csv_text([flat(entry) for entry in objects])


def flat(entry: Entry) -> Entry:
    """Return an object with a name of its own for each number."""
    row: Entry = {}
    for key, value in entry.items():
        if key.endswith("covariance_enu"):
            name = key.removesuffix("_enu")
            (ee, en), (_, nn) = value if isinstance(value, list) else _NO_COVARIANCE
            row |= {f"{name}_ee": ee, f"{name}_en": en, f"{name}_nn": nn}
        elif isinstance(value, dict):
            row |= {f"{key}_{name}": number for name, number in value.items()}
        else:
            row[key] = value
    return row


def as_geojson(objects: Sequence[Entry]) -> str:
    """Return a FeatureCollection (RFC 7946) with a feature for each batch: a point, or without
    geometry where there is no fix."""
    features = []
    for entry in objects:
        properties = dict(entry)
        place = [properties.pop(name) for name in ("longitude", "latitude")]
        point = {"type": "Point", "coordinates": place} if entry["status"] == FIX else None
        features.append({"type": "Feature", "geometry": point, "properties": properties})
    collection = {"type": "FeatureCollection", "features": features}
    return json.dumps(collection, allow_nan=False, indent=1) + "\n"


WRITERS: dict[str, Callable[[Sequence[Entry]], str]] = {
    ".json": as_json,
    ".csv": as_csv,
    ".geojson": as_geojson,
}
"""Writer by suffix."""


def write_results(objects: Sequence[Entry], path: Path) -> None:
    """Write a file in the format of its suffix, whole or not at all; raises InputError where there
    is none of that suffix, or it cannot be written."""
    writer = WRITERS.get(path.suffix.casefold())
    if writer is None:
        raise InputError(
            f"{path}: results are written to {', '.join(WRITERS)} files, not to '{path.suffix}'"
        )
    write_atomic(path, writer(objects))
