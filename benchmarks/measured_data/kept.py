"""Lines that were kept from the map: of every measured set, matched with nothing told on a map by
`isogal map grid`."""

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.maps.gridding.gridder import GridSettings, grid_survey
from isogal.maps.gridding.reading import read_survey
from isogal.maps.gridding.survey import Survey, survey_of
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.track import fit_to_map
from measured_data.lines import MGAL, Line, clear_lake, scotland, variables_of
from measured_data.matches import WHOLE, Row, Summary, row_of, summary_of
from measured_data.reference import reference_row

SHARE = 0.3
"""Of a survey's lines that are kept from its map, by lot."""
FEWEST, LEAST_ON_MAP = 30, 0.9
"""Readings of a line that is matched, and share of them that the map must cover at their true
places; those of fewer are *far*."""
GRAVITY, MAGNETIC, DEPTH = 0.5 * MGAL, 2.0, 5.0
"""1-sigma of the readings: m/s², nT, m."""
SAILED = {
    "free_air_anomaly": ("gravity_anomaly", "mGal", GRAVITY),
    "magnetic_anomaly": ("magnetic_anomaly", "nT", MAGNETIC),
    "depth": ("height", "m", DEPTH),
}
"""Quantity, unit and 1-sigma of what ships read."""
REGION = 5.0
"""deg from the middle, where a voyage is longer than one map."""
SEED = 20251126


class KeptSet(NamedTuple):
    """Lines and the map that they are not in."""

    name: str
    field_map: FieldMap
    lines: Sequence[Line]
    sigma: float
    """Of the readings."""
    away: float
    """m, 1-sigma of the prior, from which errors are drawn."""


def study_kept(
    data: Path, only: Sequence[str] | None = None, *, reference: bool = False
) -> Iterator[tuple[str, Summary]]:
    """Yield summaries of all sets (or of those whose names begin with one of some texts), and of
    all together, by the matcher and, if asked for, by the reference."""
    pooled: dict[str, list[Row]] = {}
    for one in sets(data, tuple(only or ("",))):
        for kind, rows in matched(one, reference).items():
            yield f"{one.name}{kind}", summary_of(rows) | {"nis": nis_of(one)}
            named = ({**row, "line": f"{one.name}, {row['line']}"} for row in rows)
            pooled.setdefault(kind, []).extend(named)
    for kind, rows in pooled.items():
        yield f"all{kind}", summary_of(rows)


def nis_of(one: KeptSet) -> float:
    """Return the mean squared residual of a set's readings at their true places, each over the
    variances of map and reading."""
    ratios = []
    for line in one.lines:
        track = line.track(one.sigma)
        residual = track.value - track.offset
        residual = residual - one.field_map.value(line.latitude, line.longitude)
        sigma = one.field_map.sigma_at(line.latitude, line.longitude)
        ratios.append(residual**2 / (sigma**2 + one.sigma**2))
    return float(np.nanmean(np.concatenate(ratios)))


def matched(one: KeptSet, reference: bool) -> dict[str, list[Row]]:
    """Return the rows of a set by the matcher and, if asked for, by the reference."""
    rng = generator(SEED, 0, one.name)
    rows: dict[str, list[Row]] = {"": []} | ({", reference": []} if reference else {})
    for line in one.lines:
        north, east = one.away * rng.standard_normal(2)
        shift = float(north), float(east)
        rows[""].append(_matched(line, one, shift))
        if reference:
            beside = reference_row(line, one.field_map, one.sigma, shift, one.away)
            rows[", reference"].append(beside)
    return rows


def _matched(line: Line, one: KeptSet, shift: tuple[float, float]) -> Row:
    try:
        track, _ = fit_to_map(line.track(one.sigma, shift), one.field_map)
    except InputError as error:
        return {"line": line.name, "reason": str(error)}
    settings = Matcher(batch_length=WHOLE)
    return row_of(line, match_track(track, one.field_map, settings, Uncertainty(one.away))[0])


def sets(data: Path, only: tuple[str, ...]) -> Iterator[KeptSet]:
    """Yield every measured set whose name begins with one of some texts."""
    lake, ties, flights = "Clear Lake, lines", "Scotland, ties", "Scotland, flight lines"
    if lake.startswith(only):
        survey = read_survey(data / "clear_lake_gravity_survey.nc", "bouguer_disturbance")
        yield KeptSet(lake, _gridded(survey), clear_lake(data)[1], GRAVITY, 3000.0)
    survey = read_survey(data / "scotland_magnetic_survey.nc", "magnetic_anomaly")
    if ties.startswith(only) or flights.startswith(only):
        midland = _gridded(survey)
        _, along, across = scotland(data)
        yield KeptSet(ties, midland, across, MAGNETIC, 3000.0)
        yield KeptSet(flights, midland, along, MAGNETIC, 3000.0)
    if (name := "Scotland, kept lines").startswith(only):
        yield from _by_lot(name, survey, MAGNETIC, 3000.0)
    survey = read_survey(data / "surveys" / "wisconsin_magnetics.nc", "magnetic_anomaly")
    if (name := "Wisconsin, kept lines").startswith(only):
        yield from _by_lot(name, survey, MAGNETIC, 1000.0)
    if (name := "Wisconsin, every second line").startswith(only):
        second = np.isin(survey.line, np.unique(survey.line)[1::2])
        yield from _kept(name, survey, second, MAGNETIC, 1000.0)
    for ship, variable in product(("EW0007", "EW0114"), SAILED):
        if (name := f"{ship}, {variable}").startswith(only):
            path = data / "ships" / f"{ship.lower()}_lines.nc"
            yield from _by_lot(name, _sailed(path, variable), SAILED[variable][2], 3000.0)


def _gridded(survey: Survey) -> FieldMap:
    return grid_survey(survey, GridSettings())[0]


def _sailed(path: Path, variable: str) -> Survey:
    """Return the readings of a ship outside of turns, in one region; depths as heights."""
    v, (quantity, unit, _) = variables_of(path), SAILED[variable]
    here = v["turn"] == 0.0
    for axis in ("lat", "lon"):
        if np.ptp(v[axis]) > 2.0 * REGION:
            here &= np.abs(v[axis] - np.median(v[axis])) < REGION
    columns: dict[str, Array | None] = {
        "latitude": v["lat"][here],
        "longitude": v["lon"][here],
        "value": v[variable][here] * (-1.0 if variable == "depth" else 1.0),
        "line": v["line"][here],
    }
    return survey_of(columns, unit=unit, quantity=quantity, where=f"{path}:{variable}")


def _by_lot(name: str, survey: Survey, sigma: float, away: float) -> Iterator[KeptSet]:
    numbers = np.unique(survey.line)
    drawn = generator(SEED, 0, name).random(len(numbers)) < SHARE
    yield from _kept(name, survey, np.isin(survey.line, numbers[drawn]), sigma, away)


def _kept(
    name: str, survey: Survey, out: Booleans, sigma: float, away: float
) -> Iterator[KeptSet]:
    """Yield lines that are on the map of the others, and those far from mapped lines."""
    field_map = _gridded(survey.part(~out))
    lines: dict[bool, list[Line]] = {True: [], False: []}
    for number in np.unique(survey.line[out]):
        rows = np.flatnonzero(survey.line == number)
        places = survey.places[rows, :2] - survey.places[rows, :2].mean(axis=0)
        along = places @ np.linalg.svd(places, full_matrices=False)[2][0]
        rows = rows[np.argsort(along, kind="stable")]
        line = Line(
            f"line {number}", survey.latitude[rows], survey.longitude[rows], survey.value[rows]
        )
        on_map = np.isfinite(field_map.value(line.latitude, line.longitude)).mean()
        if rows.size >= FEWEST and on_map > 0.0:
            lines[bool(on_map >= LEAST_ON_MAP)].append(line)
    yield KeptSet(name, field_map, lines[True], sigma, away)
    if lines[False]:
        yield KeptSet(f"{name}, far from others", field_map, lines[False], sigma, away)
