"""Lines matched with nothing told but the prior and the readings' noise."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.maps.field_map import FieldMap
from isogal.maps.gridding.gridder import GridSettings, grid_survey
from isogal.maps.gridding.reading import read_survey
from isogal.scenario import Matcher
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.track import fit_to_map
from measured_data.lines import FEWEST, MGAL, Line, clear_lake, scotland
from measured_data.matches import AWAY, WHOLE, Row, Summary, bearings, row_of, summary_of

GRAVITY_SIGMA = 0.5 * MGAL
MAGNETIC_SIGMA = 2.0
"""nT."""
BATCH = 30
LEFT_OUT = (2, 3, 4, 5, 6)
"""Numbers, modulo 8, of the survey's lines over Scotland that are left out together; 0 are not
among them, and 1 and 7 lie beside those."""


class Group(NamedTuple):
    """Lines that are matched alike."""

    field_map: FieldMap
    lines: Sequence[Line]
    sigma: float
    """Of the readings' white noise, in the map's unit."""
    directions: int
    length: int
    """Of a batch, readings."""


GROUPS = {
    "Clear Lake, 4 directions": (GRAVITY_SIGMA, 4, WHOLE),
    "Clear Lake, batches of 30, 2 directions": (GRAVITY_SIGMA, 2, BATCH),
    "Scotland, tie lines, 2 directions": (MAGNETIC_SIGMA, 2, WHOLE),
    "Scotland, flight lines, 2 directions": (MAGNETIC_SIGMA, 2, WHOLE),
}


def group_of(name: str, data: Path) -> Group:
    """Return one of `GROUPS` with its map and lines."""
    if name.startswith("Clear Lake"):
        field_map, lines, _ = clear_lake(data)
    else:
        field_map, flights, ties = scotland(data)
        lines = ties if "tie lines" in name else flights
    return Group(field_map, lines, *GROUPS[name])


def study_untold(data: Path) -> dict[str, Summary]:
    """Return summaries of all lines, whole and at Clear Lake in batches as well."""
    return {name: matched(*group_of(name, data)) for name in GROUPS}


def study_gridded(data: Path) -> dict[str, Summary]:
    """Return summaries of whole lines on maps made of the surveys (`isogal map grid`), and on the
    maps that come with the data."""
    lake, lines, _ = clear_lake(data)
    midland, flights, ties = scotland(data)
    own_lake, own_scotland = (
        grid_survey(read_survey(data / f"{name}_survey.nc", variable), GridSettings())[0]
        for name, variable in (
            ("clear_lake_gravity", "bouguer_disturbance"),
            ("scotland_magnetic", "magnetic_anomaly"),
        )
    )
    return {
        f"{where}, {kind}": matched(field_map, group, sigma, 2, WHOLE)
        for kind, maps in (
            ("`isogal map grid`", (own_lake, own_scotland, own_scotland)),
            ("shipped map", (lake, midland, midland)),
        )
        for (where, group, sigma), field_map in zip(
            (
                ("Clear Lake", lines, GRAVITY_SIGMA),
                ("Scotland, tie lines", ties, MAGNETIC_SIGMA),
                ("Scotland, flight lines", flights, MAGNETIC_SIGMA),
            ),
            maps,
            strict=True,
        )
    }


def study_left_out(data: Path) -> dict[str, Summary]:
    """Return summaries of lines of Scotland's survey itself, every eighth matched on a map that is
    made of the others: what there is to learn from the survey of how right fixes are."""
    survey = read_survey(data / "scotland_magnetic_survey.nc", "magnetic_anomaly")
    assert survey.line is not None
    rows: list[Row] = []
    results = {}
    for first in LEFT_OUT:
        out = survey.line % 8 == first
        field_map, _ = grid_survey(survey.part(~out), GridSettings())
        lines = []
        for number in np.unique(survey.line[out]):
            row = np.flatnonzero(survey.line == number)
            row = row[np.argsort(survey.longitude[row], kind="stable")]
            where = survey.latitude[row], survey.longitude[row]
            on_map = np.isfinite(field_map.value(*where)).mean()
            if row.size >= FEWEST and on_map > 0.9:
                lines.append(Line(f"line {number}", *where, survey.value[row]))
        found = matched(field_map, lines, MAGNETIC_SIGMA, 2, WHOLE)
        rows += found["rows"]
        results[f"lines {first}, {first + 8}, ..."] = found
    return results | {"all": summary_of(rows)}


def matched(
    field_map: FieldMap,
    lines: Sequence[Line],
    sigma: float,
    directions: int,
    length: int,
    name: str = "pmht",
) -> Summary:
    """Return the summary of lines that are matched from some directions."""
    settings = Matcher(name=name, batch_length=length)
    rows = []
    for line in lines:
        for shift in bearings(directions):
            track, _ = fit_to_map(line.track(sigma, shift), field_map)
            matches = match_track(track, field_map, settings, Uncertainty(position=AWAY))
            rows += [row_of(line, match) for match in matches]
    return summary_of(rows)
