"""Real readings along real tracks, with simulated inertial sensors, on real maps.

    python benchmarks/real.py --data DIR --out DIR [--runs 4] [--page docs/evidence/real.md]

Voyages are legs of a ship (EW0007, DIR/ships) that sailed corridors of other days again, and
aeromagnetic lines (north-east Wisconsin, DIR/surveys) of which every second one is in the map. The
maps are gridded, as `isogal map grid` does, from readings of other days, or of the other lines.
Each run has another draw of the INS's errors."""

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import closed_loop  # first: it asks NumPy for one thread
import netCDF4
import numpy as np

from isogal.arrays import Array, Booleans
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.judgement import judge
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.gridding.gridder import GridSettings, grid_survey
from isogal.maps.gridding.survey import survey_of
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, validate_scenario
from isogal.sensors.trajectory import build_trajectory

SHIP, LINES = "ships/ew0007_lines.nc", "surveys/wisconsin_magnetics.nc"
APART = 720.0
"""Minutes between a leg of the ship and the readings of its maps."""
FEWEST = {SHIP: 150, LINES: 50}
"""Readings of a voyage."""
NEAR = {SHIP: 2500.0, LINES: 1000.0}
"""m; voyages have a reading of the map as near at nine places of ten."""
MARGIN = 0.4
"""deg of map beside a voyage."""
NARROWEST = 0.1
"""Width of what is mapped beside its length: less is a line, across which nobody knows the field.
"""
FIELDS: dict[str, dict[str, Any]] = {
    "gravity": {
        "field": "disturbance",
        "sigma": 0.7e-5,  # m/s²: crossings of the ship differ by 0.74 mGal
        "readings": {"column": "free_air_anomaly"},
    },
    "magnetics": {
        "field": "magnetic",
        "sigma": 3.0,
        # the daily variation, which nobody has taken off: tens of nT, over a day and over hours
        "gravimeter": {"correlated_sigma": 20.0, "correlation_time": 7200.0, "bias": 40.0},
        "matcher": {"bias_sigma": 40.0},
        "readings": {"column": "magnetic_anomaly"},
    },
    "depth": {"field": "terrain", "sigma": 10.0, "readings": {"column": "depth"}},
}
VARIABLES = {
    "gravity": ("free_air_anomaly", "disturbance", "mGal", 1.0),
    "magnetics": ("magnetic_anomaly", "magnetic_anomaly", "nT", 1.0),
    "depth": ("depth", "height", "m", -1.0),
}
"""Variable, quantity of its map, unit and sign of each field."""
INS: dict[str, dict[str, Any]] = {
    "precision": {"imu": {"grade": "precision"}},
    "tactical": {"imu": {"grade": "tactical"}},
    "tactical, log": {"imu": {"grade": "tactical"}, "velocity": {"kind": "log", "interval": 10.0}},
}
CASES = {
    SHIP: (("gravity", "magnetics", "depth", "all"), ("precision", "tactical, log")),
    LINES: (("magnetics",), ("precision", "tactical")),
}
SETTLED = {SHIP: 3600.0, LINES: 600.0}
"""s, after which errors count."""


@dataclass(frozen=True)
class Voyage:
    """A leg or a line."""

    file: str
    line: int

    @property
    def name(self) -> str:
        """For file names."""
        return f"{Path(self.file).stem}-{self.line}"


def numbers(path: Path) -> dict[str, Array]:
    """Return the variables of a file, (N,) each."""
    with netCDF4.Dataset(str(path)) as dataset:
        return {
            name: np.ma.filled(np.ma.asarray(data[:], dtype=float), np.nan)
            for name, data in dataset.variables.items()
        }


def mapped(found: dict[str, Array], file: str, line: float) -> Booleans:
    """Return (N,) which readings the map of a voyage is made of: around it those of other days, or
    of the lines that are no voyages."""
    own, time = found["line"] == line, found["time"]
    if file == LINES:
        used = np.isin(found["line"], np.unique(found["line"])[1::2])
    else:
        used = (time < time[own].min() - APART) | (time > time[own].max() + APART)
    for axis, reach in (("lat", MARGIN), ("lon", 1.5 * MARGIN)):
        low, high = found[axis][own].min() - reach, found[axis][own].max() + reach
        used &= (found[axis] >= low) & (found[axis] <= high)
    return np.asarray(used)


def voyages(data: Path, file: str) -> list[Voyage]:
    """Return the legs or lines of a file that are long enough and on the map of the others."""
    from scipy.spatial import cKDTree

    found, chosen = numbers(data / file), []
    east = np.cos(np.radians(np.median(found["lat"])))
    places = 111e3 * np.column_stack([found["lat"], east * found["lon"]])
    for k, line in enumerate(np.unique(found["line"])):
        own = found["line"] == line
        if own.sum() < FEWEST[file] or (file == LINES and k % 2):
            continue
        around = places[mapped(found, file, line)]
        away = cKDTree(around).query(places[own])[0]
        width, length = np.sqrt(np.linalg.eigvalsh(np.cov(around.T)))
        if np.quantile(away, 0.9) < NEAR[file] and width > NARROWEST * length:
            chosen.append(Voyage(file, int(line)))
    return chosen


def map_of(data: Path, voyage: Voyage, field: str, folder: Path) -> Path:
    """Return the file of a voyage's map, which is made where it is not there yet."""
    path = folder / f"{voyage.name}-{field}.nc"
    if path.exists():
        return path
    found = numbers(data / voyage.file)
    used = mapped(found, voyage.file, voyage.line)
    name, quantity, unit, sign = VARIABLES[field]
    columns: dict[str, Array | None] = {
        "latitude": found["lat"][used],
        "longitude": found["lon"][used],
        "value": sign * found[name][used],
        "line": found["line"][used],
    }
    survey = survey_of(columns, unit=unit, quantity=quantity, where=voyage.name)
    write_netcdf(grid_survey(survey, GridSettings(method="kriging"))[0], path)
    return path


def scenario_of(data: Path, voyage: Voyage, field: str, ins: str, folder: Path) -> Scenario:
    """Return the scenario of a voyage with the readings of a field, or of all."""
    fields = list(FIELDS) if field == "all" else [field]
    entries = []
    for one in fields:
        entry = FIELDS[one] | {"map": {"source": str(map_of(data, voyage, one, folder))}}
        entry["interval"] = 20.0 if voyage.file == LINES else 60.0
        if voyage.file == LINES:  # the daily variation has been taken off
            entry |= {"gravimeter": {}, "matcher": {}}
        entries.append(entry)
    file = str(data / voyage.file)
    return validate_scenario(
        {
            "route": {"track": file, "track_line": str(voyage.line), "height": 0.0},
            "readings": {"source": file},
            "map": {"continuation": "none"},
            "gravity": {"field": "normal"},
            "fields": entries,
            "seed": voyage.line,
            **INS[ins],
        }
    )


def study(data: Path, folder: Path, runs: int, task: tuple[Voyage, str, str]) -> dict[str, Any]:
    """Return the figures of one voyage's runs; those that are in the folder are not computed
    again."""
    voyage, field, ins = task
    kept = folder / f"{voyage.name} {field} {ins} {runs}.json"
    if kept.exists():
        return dict(json.loads(kept.read_text(encoding="utf-8")))
    scenario = scenario_of(data, voyage, field, ins, folder)
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    record = simulate(scenario, range(runs), maps)
    bound = posterior_cramer_rao(scenario.true, trajectory, maps).rms_at(record.time)
    late = record.elapsed > SETTLED[voyage.file]
    nees = nees_per_axis(record.error[:, late], record.covariance[:, late])
    worse = judge(record, np.zeros(len(record), dtype=np.bool_))["worse_than_unaided"]
    found = {
        "file": voyage.file,
        "field": field,
        "ins": ins,
        "line": voyage.line,
        "hours": float(trajectory.time[-1] / 3600.0),
        "squared": (record.horizontal_error[:, late] ** 2).mean(axis=1).tolist(),
        "unaided": (record.unaided_horizontal_error[:, late] ** 2).mean(axis=1).tolist(),
        "bound": float((bound[late] ** 2).mean()),
        "nees": nees.mean(axis=1).tolist(),
        "worse": int(worse.sum()),
        "fixes": int(record.published.sum()),
        "declined": int((~record.published).sum()),
    }
    kept.write_text(json.dumps(found), encoding="utf-8")
    return found


def table(found: list[dict[str, Any]]) -> str:
    """Return a row for each field and INS: all its voyages together, voyages as clusters."""
    head = ["readings", "INS", "voyages", "hours", "RMS, m", "unaided, m", "bound, m", "NEES",
            "NEES by voyage", "runs worse than unaided", "fixes, declined"]  # fmt: skip
    rows = []
    for key in dict.fromkeys((one["file"], one["field"], one["ins"]) for one in found):
        own = [one for one in found if (one["file"], one["field"], one["ins"]) == key]
        nees = np.array([np.mean(one["nees"]) for one in own])
        mean, error = closed_loop.jackknife(lambda values: float(values.mean()), nees)
        runs = sum(len(one["squared"]) for one in own)
        of = "ship" if key[0] == SHIP else "flight"
        rms = [np.sqrt(np.mean([one[name] for one in own])) for name in ("squared", "unaided")]
        bound = np.sqrt(np.mean([one["bound"] for one in own]))
        rows.append(
            [f"{of}: {key[1]}", key[2], f"{len(own)}", f"{sum(x['hours'] for x in own):.0f}",
             f"{rms[0]:.0f}", f"{rms[1]:.0f}", f"{bound:.0f}", f"{mean:.2f} ± {error:.2f}",
             f"{nees.min():.2f} to {nees.max():.2f}", f"{sum(x['worse'] for x in own)} of {runs}",
             f"{sum(x['fixes'] for x in own)}, {sum(x['declined'] for x in own)}"]
        )  # fmt: skip
    return closed_loop.markdown(head, rows)


def main() -> None:
    """Run it."""
    options = closed_loop.parser(__doc__, "data", "out", "page", "workers", "rows", runs=4)
    options.add_argument("--most", type=int, help="voyages of each file; default: all")
    asked = options.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    tasks = [
        (voyage, field, ins)
        for file, (fields, grades) in CASES.items()
        for field in fields
        for ins in grades
        for voyage in voyages(asked.data, file)[: asked.most]
        if closed_loop.containing(f"{voyage.name} {field} {ins}", asked.rows)
    ]
    found = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for one in pool.map(partial(study, asked.data, asked.out, asked.runs), tasks):
            found.append(one)
            print(one["line"], one["field"], one["ins"], flush=True)
    text = table(found)
    print(text)
    closed_loop.write_between(asked.page, closed_loop.marks_of(__file__), text)


if __name__ == "__main__":
    main()
