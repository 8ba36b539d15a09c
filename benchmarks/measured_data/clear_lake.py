"""The study at Clear Lake: four lines of gravity stations, each with the correlation length and
the sensor noise that the other three show."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isogal.maps.field_map import FieldMap
from isogal.tracks.map_error import fit_map_error
from measured_data.lines import MGAL, Line, Shift, clear_lake
from measured_data.matches import (
    Noise,
    Row,
    Summary,
    bearings,
    match_line,
    nis,
    noise_of,
    rigid_search,
    row_of,
    settings_of,
    summary_of,
    whole_line,
)

GROWTH = (10, 15, 20, 30, 45, 60, 90, 120)
"""Numbers of readings after which a line's fix is assessed."""
BATCH = 30
"""Readings of a batch where lines are not taken as a whole."""
DEFAULT = Noise(4000.0, 0.5 * MGAL)
"""Where nothing is learnt: the correlation length that `isogal match` assumes, and 0.5 mGal."""
DIRECTIONS = 4
"""From which a line is matched."""
Medians = dict[str, float]
Lake = dict[str, dict[str, float | list[float] | Summary | list[dict[str, float | Medians]]]]
"""What there is to say of Clear Lake, by kind and line; of `batches` by kind of assumptions."""


def study_clear_lake(data: Path) -> Lake:
    """Return everything about Clear Lake."""
    field_map, lines, scattered = clear_lake(data)
    everything = fit_map_error([line.track(1.0) for line in lines], field_map)
    result: Lake = {
        "stations": {line.name: int(line.value.size) for line in lines},
        "settings": {"all lines": settings_of(everything)},
        "nis": {"scattered": _nis(scattered, field_map, noise_of(everything))},
        **{kind: {} for kind in ("whole", "bare", "white", "unlearnt", "rigid_m", "growth")},
    }
    batches: dict[str, list[Row]] = {}
    for line in lines:
        others = [other.track(1.0) for other in lines if other is not line]
        fit = fit_map_error(others, field_map)
        noise = noise_of(fit)
        result["settings"][line.name] = settings_of(fit)
        result["nis"][line.name] = _nis(line, field_map, noise)
        for kind, rows in _whole(line, field_map, noise, bearings(DIRECTIONS)).items():
            result[kind][line.name] = summary_of(rows)
        result["rigid_m"][line.name] = [
            rigid_search(line, field_map, shift) for shift in bearings(DIRECTIONS)
        ]
        counts = [*(n for n in GROWTH if n < line.value.size), line.value.size]
        result["growth"][line.name] = [
            {"readings": n} | _growth_at(line.part(slice(n)), field_map, noise) for n in counts
        ]
        for kind, rows in _batches(line, field_map, noise, bearings(DIRECTIONS)[:2]).items():
            batches.setdefault(kind, []).extend(rows)
    result["batches"] = {kind: summary_of(rows) for kind, rows in batches.items()}
    return result


def _nis(line: Line, field_map: FieldMap, noise: Noise) -> list[float]:
    """Return the NIS per reading and of the mean, with white and with correlated map errors."""
    return [*nis(line, field_map, noise.white), *nis(line, field_map, noise)]


def _whole(
    line: Line, field_map: FieldMap, noise: Noise, shifts: Sequence[Shift]
) -> dict[str, list[Row]]:
    """Match a line as one batch from each direction, with each kind of assumption."""
    kinds = {
        "whole": (noise, True),
        "bare": (noise, False),
        "white": (noise.white, False),
        "unlearnt": (DEFAULT, True),
    }
    return {
        kind: [whole_line(line, field_map, own, shift, checked=checked) for shift in shifts]
        for kind, (own, checked) in kinds.items()
    }


def _batches(
    line: Line, field_map: FieldMap, noise: Noise, shifts: Sequence[Shift]
) -> dict[str, list[Row]]:
    """Match a line in batches from each direction, with each kind of assumption."""
    kinds = {
        "independent": (noise, False, True),
        "bare": (noise, False, False),
        "chained": (noise, True, True),
        "white": (noise.white, False, False),
    }
    found: dict[str, list[Row]] = {}
    for kind, (own, chained, checked) in kinds.items():
        how = {"batch_length": BATCH, "chained": chained, "checked": checked}
        found[kind] = [
            row_of(line, match, aided=chained)
            for shift in shifts
            for match in match_line(line, field_map, own, shift, **how)
        ]
    return found


def _growth_at(line: Line, field_map: FieldMap, noise: Noise) -> dict[str, Medians]:
    """Return medians over two directions of error and 1-sigma of prior and fix together after the
    readings of a line; white: from the likelihood alone."""
    shifts = [shift for shift in bearings(2) if _starts_on_map(line, field_map, shift)]
    result = {}
    for kind, own, checked in (("correlated", noise, True), ("white", noise.white, False)):
        rows = [
            whole_line(line, field_map, own, shift, checked=checked, aided=True)
            for shift in shifts
        ]
        result[kind] = {
            key: float(np.median([row[key] for row in rows])) if rows else math.nan
            for key in ("error_m", "sigma_long_m", "nees_per_axis")
        }
    return result


def _starts_on_map(line: Line, field_map: FieldMap, shift: Shift) -> bool:
    track = line.track(1.0, shift)
    return int(np.isfinite(field_map.value(track.latitude, track.longitude)).sum()) >= 4
