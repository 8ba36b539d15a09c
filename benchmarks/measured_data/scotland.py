"""The study over Scotland: aeromagnetic lines, with the map error that the other group of lines
shows."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isogal.maps.field_map import FieldMap
from isogal.tracks.map_error import fit_map_error
from measured_data.lines import Line, scotland
from measured_data.matches import (
    bearings,
    nis,
    noise_of,
    residuals,
    rigid_search,
    settings_of,
    summary_of,
    whole_line,
)

LEAST_SENSOR = 1.0
"""nT; no aeromagnetic reading of the time was more precise."""


def study_scotland(
    data: Path, directions: int = 2, thin: int = 3, swap: bool = True
) -> dict[str, Any]:
    """Return everything about Scotland: settings from the flight lines, applied to the tie lines,
    and with `swap` the other way round; settings are taken from every `thin`-th reading."""
    field_map, flights, ties = scotland(data)
    result = {"tie lines": _matched(field_map, flights, ties, directions, thin)}
    if swap:
        result["flight lines"] = _matched(field_map, ties, flights, directions, thin)
    return result


def _matched(
    field_map: FieldMap,
    references: Sequence[Line],
    lines: Sequence[Line],
    directions: int,
    thin: int,
) -> dict[str, Any]:
    """Return what becomes of lines with the settings that the references show."""
    thinned = [line.part(slice(None, None, thin)).track(1.0) for line in references]
    fit = fit_map_error(thinned, field_map)
    noise = noise_of(fit, LEAST_SENSOR)
    own = fit.apply(field_map)
    spread = np.concatenate([residuals(line, field_map)[0] for line in references])
    even_sigma = float(np.sqrt(np.nanmean(spread**2)))
    even = replace(field_map, sigma=np.full(field_map.values.shape, even_sigma))
    kinds = {
        "own": (own, noise, True),
        "bare": (own, noise, False),
        "even": (even, noise, True),
        "white": (own, noise.white, False),
    }
    part: dict[str, Any] = {
        "settings": settings_of(fit) | {"even_sigma": even_sigma},
        "nis": {
            kind: np.mean([nis(line, used, assumed) for line in lines], axis=0).tolist()
            for kind, (used, assumed, _) in kinds.items()
        },
    }
    for kind, (used, assumed, checked) in kinds.items():
        rows = [
            whole_line(line, used, assumed, shift, checked=checked)
            for line in lines
            for shift in bearings(directions)
        ]
        part[kind] = summary_of(rows) | {"rows": rows}
    errors = [rigid_search(line, field_map, bearings(directions)[0]) for line in lines]
    part["rigid"] = {
        "error_median_m": float(np.median(errors)),
        "error_90_m": float(np.percentile(errors, 90.0)),
    }
    return part
