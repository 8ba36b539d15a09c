"""The study over Scotland: aeromagnetic lines, with the map error that the other group of lines
shows."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from isogal.maps.field_map import FieldMap
from isogal.tracks.map_error import fit_map_error
from measured_data.lines import Line, scotland
from measured_data.matches import (
    Summary,
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


DIRECTIONS, THIN = 2, 3
"""From which a line is matched; settings are taken from every third reading."""


Part = dict[str, dict[str, float] | Summary]
"""What becomes of lines: the `settings` that others show (with `even_sigma`, nT, the same
everywhere), and summaries with these, of the likelihood alone (`bare`), with `even_sigma`, with
white noise, and by least squares (`rigid`)."""


def study_scotland(data: Path) -> dict[str, Part]:
    """Return everything about Scotland: settings from the flight lines, applied to the tie lines,
    and the other way round."""
    field_map, flights, ties = scotland(data)
    return {
        "tie lines": _matched(field_map, flights, ties),
        "flight lines": _matched(field_map, ties, flights),
    }


def _matched(field_map: FieldMap, references: Sequence[Line], lines: Sequence[Line]) -> Part:
    thinned = [line.part(slice(None, None, THIN)).track(1.0) for line in references]
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
    errors = [rigid_search(line, field_map, bearings(DIRECTIONS)[0]) for line in lines]
    part: Part = {
        "settings": settings_of(fit) | {"even_sigma": even_sigma},
        "rigid": summary_of([{"error_m": error} for error in errors]),
    }
    for kind, (used, assumed, checked) in kinds.items():
        rows = [
            whole_line(line, used, assumed, shift, checked=checked)
            for line in lines
            for shift in bearings(DIRECTIONS)
        ]
        per_reading = float(np.mean([nis(line, used, assumed)[0] for line in lines]))
        part[kind] = summary_of(rows) | {"nis": per_reading}
    return part
