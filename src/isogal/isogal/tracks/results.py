"""Results of matching a track as JSON, CSV and GeoJSON, with one object for each batch."""

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import write_atomic
from isogal.tracks.matching import Match

FIX, NO_FIX = "fix", "no_fix"
_DEGREE_DIGITS = 9
"""Decimals of degrees: 0.1 mm."""


_ESTIMATED = ("map_sigma", "map_correlation_length", "offset", "offset_sigma")
_NOT_IN_UNIT = "map_correlation_length"


def as_objects(
    matches: Sequence[Match],
    chained: bool = False,
    *,
    factor: float = 1.0,
    line: str | None = None,
    others: Mapping[str, float] | None = None,
) -> list[dict[str, Any]]:
    """Return one object for each batch: time s, latitude and longitude deg, covariance_enu m²
    (None = no fix), status, reason.

    Without a fix the position is that of the track. Objects also hold the position and its
    covariance with the prior (`with_prior_*`), of chained batches with all fixes so far
    (`aided_*`). Where noise was integrated out they
    hold what was estimated, in units of which one has `factor` units inside, and m. `line` is
    that of the track's file. `others` are the factors of further fields by name, of which
    NAME_estimated is told."""
    factors = {"": factor} | {f"{name}.": one for name, one in (others or {}).items()}
    return [_object(match, chained, factors, line) for match in matches]


def _object(
    match: Match, chained: bool, factors: Mapping[str, float], line: str | None
) -> dict[str, Any]:
    fix = match.fix
    result: dict[str, Any] = {} if line is None else {"line": line}
    result |= {
        "time": fix.time,
        **_place(fix.latitude, fix.longitude),
        "covariance_enu": _enu(fix.covariance) if fix.published else None,
        "status": FIX if fix.published else NO_FIX,
        "reason": fix.reason,
    }
    name = "aided" if chained else "with_prior"
    result |= {f"{name}_{key}": value for key, value in _place(*match.position).items()}
    result[f"{name}_covariance_enu"] = _enu(match.covariance[:2, :2])
    numbers = fix.diagnostics
    if match.shifts is None:
        return result
    for prefix, factor in factors.items():
        if f"{prefix}map_sigma" in numbers:
            result[f"{prefix.replace('.', '_')}estimated"] = _estimated(numbers, prefix, factor)
    if "map_sigma" in numbers:
        result["readings"] = int(numbers["readings"])
        result["readings_left_out"] = int(numbers["readings_left_out"])
        result["misfit"] = round(numbers["misfit"], 3)
        result["places"] = int(numbers["places"])
        result["probability"] = round(numbers["probability"], 4)
    return result


def _estimated(numbers: Mapping[str, float], prefix: str, factor: float) -> dict[str, float]:
    """Return what was estimated of a field's errors, in its unit."""
    return {
        name: float(f"{numbers[prefix + name] / (1.0 if name == _NOT_IN_UNIT else factor):.4g}")
        for name in _ESTIMATED
    }


def _place(latitude: float, longitude: float) -> dict[str, float]:
    turned = math.degrees(math.remainder(longitude, 2.0 * math.pi))
    return {
        "latitude": round(math.degrees(latitude), _DEGREE_DIGITS),
        "longitude": round(turned, _DEGREE_DIGITS),
    }


def _enu(covariance: Array) -> list[list[float]]:
    """Return a covariance of north and east, (2, 2), as lists in the order east, north."""
    return [[float(covariance[i, j]) for j in (1, 0)] for i in (1, 0)]


def as_json(objects: Sequence[dict[str, Any]]) -> str:
    """Return a JSON array with one object in each line."""
    lines = ",\n  ".join(json.dumps(item, allow_nan=False) for item in objects)
    return f"[\n  {lines}\n]\n" if objects else "[]\n"


def as_csv(objects: Sequence[dict[str, Any]]) -> str:
    """Return a table with three columns for each covariance: east-east, east-north,
    north-north."""
    rows = [_flat(entry) for entry in objects]
    stream = io.StringIO()
    writer = csv.DictWriter(
        stream,
        fieldnames=list(dict.fromkeys(key for row in rows for key in row)),
        lineterminator="\n",
    )
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _flat(entry: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for key, value in entry.items():
        if key.endswith("covariance_enu"):
            name = key.removesuffix("_enu")
            (ee, en), (_, nn) = value or [[None, None], [None, None]]
            row |= {f"{name}_ee": ee, f"{name}_en": en, f"{name}_nn": nn}
        elif isinstance(value, dict):
            row |= {f"{key}_{name}": number for name, number in value.items()}
        else:
            row[key] = value
    return row


def as_geojson(objects: Sequence[dict[str, Any]]) -> str:
    """Return a FeatureCollection (RFC 7946) with a feature for each batch: a point, or without
    geometry where there is no fix."""
    features = []
    for entry in objects:
        point = {"type": "Point", "coordinates": [entry["longitude"], entry["latitude"]]}
        properties = {
            key: value for key, value in entry.items() if key not in ("latitude", "longitude")
        }
        features.append(
            {
                "type": "Feature",
                "geometry": point if entry["status"] == FIX else None,
                "properties": properties,
            }
        )
    return (
        json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False, indent=1)
        + "\n"
    )


WRITERS: dict[str, Callable[[Sequence[dict[str, Any]]], str]] = {
    ".json": as_json,
    ".csv": as_csv,
    ".geojson": as_geojson,
}
"""Writer by suffix."""


def writer_for(path: Path) -> Callable[[Sequence[dict[str, Any]]], str]:
    """Return the writer for a file by its suffix; raises InputError where there is none."""
    writer = WRITERS.get(path.suffix.casefold())
    if writer is None:
        raise InputError(
            f"{path}: results are written to {', '.join(WRITERS)} files, not to '{path.suffix}'"
        )
    return writer


def write_results(objects: Sequence[dict[str, Any]], path: Path) -> None:
    """Write a file in the format of its suffix, whole or not at all; raises InputError."""
    write_atomic(path, writer_for(path)(objects))
