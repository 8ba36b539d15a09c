"""Lines that were kept from the map: of every measured set, matched with nothing told on a map by
`isogal map grid`."""

import pickle
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from pathlib import Path

import numpy as np
from closed_loop import containing, of_source

from isogal.arrays import Array, Booleans
from isogal.errors import InputError
from isogal.files import write_atomic
from isogal.maps.field_map import FieldMap
from isogal.maps.gridding.gridder import GridSettings, grid_survey
from isogal.maps.gridding.reading import read_survey
from isogal.maps.gridding.survey import Survey, survey_of
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.track import fit_to_map
from measured_data.lines import MGAL, Line, Shift, clear_lake, scotland, variables_of
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
KEPT = Path(__file__).parents[2] / "build" / "real_data"
"""Folder of maps that were made."""
NAMES = (
    *("Clear Lake", "Scotland", "Scotland, kept lines"),
    *("Wisconsin, kept lines", "Wisconsin, every second line"),
    *(f"{ship}, {variable}" for ship, variable in product(("EW0007", "EW0114"), SAILED)),
)
"""Of surveys and what is kept of them: of each there is one map."""


@dataclass(frozen=True)
class KeptSet:
    """Lines and the map that they are not in."""

    name: str
    field_map: FieldMap
    lines: Sequence[Line]
    sigma: float
    """Of the readings."""
    away: float
    """m, 1-sigma of the prior."""

    @cached_property
    def shifts(self) -> list[Shift]:
        """Errors of the lines, drawn from the prior."""
        rng = generator(SEED, 0, self.name)
        drawn = self.away * rng.standard_normal((len(self.lines), 2))
        return [(north, east) for north, east in drawn.tolist()]

    @cached_property
    def reference(self) -> list[Row]:
        """Rows of the lines by the reference."""
        return [
            reference_row(line, self.field_map, self.sigma, shift, self.away)
            for line, shift in zip(self.lines, self.shifts, strict=True)
        ]


def study_kept(
    data: Path, only: Sequence[str] | None, workers: int
) -> Iterator[tuple[str, Summary]]:
    """Yield summaries of all sets of which the map's name has one of some texts in it, by the
    matcher and by the reference, and of all together."""
    names = [name for name in NAMES if containing(name, only)]
    pooled: dict[str, list[Row]] = {"": [], ", reference": []}
    with ProcessPoolExecutor(workers) as pool:
        for found in pool.map(partial(_matched_sets, data), names):
            for name, (rows, beside, nis) in found.items():
                yield name, summary_of(rows) | {"nis": nis}
                yield f"{name}, reference", summary_of(beside)
                for kind, each in zip(pooled, (rows, beside), strict=True):
                    pooled[kind] += [{**row, "line": f"{name}, {row['line']}"} for row in each]
    for kind, rows in pooled.items():
        yield f"all{kind}", summary_of(rows)


def _matched_sets(data: Path, name: str) -> dict[str, tuple[list[Row], list[Row], float]]:
    """Return of the sets of a map, by their names, the rows by the matcher and by the reference,
    and `nis_of`."""
    return {one.name: (matched(one), one.reference, nis_of(one)) for one in prepared(data, name)}


def prepared(data: Path, name: str) -> list[KeptSet]:
    """Return the sets of one of `NAMES` with their reference, from the file where it is: neither
    depends on the matcher."""
    import isogal

    library, own = Path(isogal.__file__).parent, Path(__file__).parent
    path = KEPT / f"{of_source(name, (library / 'earth', library / 'maps', own))}.pickle"
    if path.exists():
        return list(pickle.loads(path.read_bytes()))
    made = list(sets(data, name))
    for one in made:
        one.reference  # noqa: B018 - is kept with the map
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, pickle.dumps(made))
    return made


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


def matched(one: KeptSet) -> list[Row]:
    """Return the rows of a set by the matcher."""
    return [_matched(*line, one) for line in zip(one.lines, one.shifts, strict=True)]


def _matched(line: Line, shift: Shift, one: KeptSet) -> Row:
    try:
        track, _ = fit_to_map(line.track(one.sigma, shift), one.field_map)
    except InputError as error:
        return {"line": line.name, "reason": str(error)}
    settings = Matcher(batch_length=WHOLE)
    return row_of(line, match_track(track, one.field_map, settings, Uncertainty(one.away))[0])


def sets(data: Path, name: str) -> Iterator[KeptSet]:
    """Yield the sets of one of `NAMES`."""
    if name == "Clear Lake":
        survey = read_survey(data / "clear_lake_gravity_survey.nc", "bouguer_disturbance")
        yield KeptSet("Clear Lake, lines", _gridded(survey), clear_lake(data)[1], GRAVITY, 3000.0)
    elif name.startswith("Scotland"):
        survey = read_survey(data / "scotland_magnetic_survey.nc", "magnetic_anomaly")
        if name == "Scotland, kept lines":
            yield from _by_lot(name, survey, MAGNETIC, 3000.0)
            return
        midland = _gridded(survey)
        _, along, across = scotland(data)
        yield KeptSet("Scotland, ties", midland, across, MAGNETIC, 3000.0)
        yield KeptSet("Scotland, flight lines", midland, along, MAGNETIC, 3000.0)
    elif name.startswith("Wisconsin"):
        survey = read_survey(data / "surveys" / "wisconsin_magnetics.nc", "magnetic_anomaly")
        if name == "Wisconsin, kept lines":
            yield from _by_lot(name, survey, MAGNETIC, 1000.0)
            return
        second = np.isin(survey.line, np.unique(survey.line)[1::2])
        yield from _kept(name, survey, second, MAGNETIC, 1000.0)
    else:
        ship, variable = name.split(", ")
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
