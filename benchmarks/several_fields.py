"""What two fields bring against each alone, over the same ground, with the same random numbers.

    python benchmarks/several_fields.py --data DIR --out DIR [--runs 16] [--cases TEXT ...]
        [--page docs/evidence/several-fields.md]

DIR of `--data` holds `kalgoorlie_gravity_magnetic.nc`: measured maps of the Bouguer anomaly, which
is taken for the disturbance here, and of the magnetic anomaly. A case is a closed loop of so many
runs of two hours, with gravity, with magnetics, and with both. RMS errors and the bound are over
the time after the first hour. Runs that are in `--out` are not computed again; after a change of
the library, begin with an empty folder."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pages import write_between

from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import summarise
from isogal.fields.scenario_map import maps_for_scenario
from isogal.files import write_atomic
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, validate_scenario
from isogal.sensors.trajectory import build_trajectory

MARKS = "<!-- table of benchmarks/several_fields.py -->", "<!-- end of the table -->"
CHUNK = 4
"""Runs that are kept together."""
BASE = {
    "route": {
        "start": [-31.9, 121.0], "end": [-30.3, 122.2], "speed": 22.0, "duration": 7200.0,
        "height": 100.0,
    },
    "gravity": {"field": "normal"},
    "map": {"continuation": "none"},
}  # fmt: skip


def _wrong(sigma: float, told: float | None = None) -> dict[str, Any]:
    """Return the keys of a map in error by a 1-sigma, which is told unless another is."""
    return {
        "map_error": {"sigma": sigma},
        "matcher": {"map_sigma": sigma if told is None else told},
    }


@dataclass(frozen=True)
class Case:
    """Keys of both entries, and of the scenario."""

    name: str
    gravity: dict[str, Any]
    magnetic: dict[str, Any]
    more: dict[str, Any] = field(default_factory=dict)


_GRAVITY, _MAGNETIC = {"sigma": 1e-6}, {"sigma": 10.0}
ALIKE = _GRAVITY | _wrong(1e-6), _MAGNETIC | _wrong(30.0)
CASES = (
    Case("both alike, told", *ALIKE),
    Case(
        "both alike, nothing told",
        _GRAVITY | {"map_error": {"sigma": 1e-6}},
        _MAGNETIC | {"map_error": {"sigma": 30.0}},
    ),
    Case("exact maps", _GRAVITY | _wrong(0.0), {"sigma": 20.0} | _wrong(0.0)),
    Case("magnetics far better", {"sigma": 1e-5} | _wrong(3e-6), {"sigma": 2.0} | _wrong(10.0)),
    Case("gravity far better", ALIKE[0], {"sigma": 50.0} | _wrong(150.0)),
    Case("magnetometer every 4 s", ALIKE[0], ALIKE[1] | {"interval": 4.0}),
    Case("start known to 5 km", *ALIKE, {"initial_error": {"position": 5000.0}}),
    Case("magnetic map twice as wrong as told", ALIKE[0], _MAGNETIC | _wrong(30.0, 15.0)),
)
"""1-sigmas: gravity in m/s² (1e-6 is 0.1 mGal), magnetics in nT."""


def scenarios(case: Case, data: Path, out: Path) -> dict[str, Scenario]:
    """Return the scenario of each alone and of both; the random streams are the same."""
    source = data / "kalgoorlie_gravity_magnetic.nc"
    disturbance = out / "disturbance.nc"
    if not disturbance.exists():
        out.mkdir(parents=True, exist_ok=True)
        bouguer = load_map(source, "bouguer_anomaly")
        write_netcdf(replace(bouguer, quantity="disturbance"), disturbance)
    first = {"field": "disturbance", "map": {"source": str(disturbance)}} | case.gravity
    second = {
        "field": "magnetic",
        "map": {"source": str(source), "variable": "magnetic_anomaly"},
    } | case.magnetic
    base = BASE | case.more
    both = validate_scenario(base | {"fields": [first, second]})
    second["seed"] = both.each_field[1].seed
    alone = {"gravity": first, "magnetics": second}
    return {name: validate_scenario(base | {"fields": [one]}) for name, one in alone.items()} | {
        "both": both
    }


def runs_of(scenario: Scenario, count: int, out: Path) -> Runs:
    """Return runs of a scenario, from the folder where they are."""
    text = json.dumps(scenario.model_dump(mode="json", exclude_defaults=True), sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:16]
    maps = maps_for_scenario(scenario)
    parts = []
    for first in range(0, count, CHUNK):
        runs = range(first, min(first + CHUNK, count))
        path = out / f"{name}-{runs.start}-{runs.stop}.npz"
        if not path.exists():
            simulate(scenario, runs, maps).save(path)
        parts.append(Runs.load(path))
    return Runs.concatenate(parts)


def figures(scenario: Scenario, runs: Runs) -> dict[str, Any]:
    """Return RMS errors after the first hour, of all runs (m) and of each (m²), and what to
    compare them with."""
    trajectory = build_trajectory(scenario)
    bound = posterior_cramer_rao(scenario, trajectory, maps_for_scenario(scenario, trajectory))
    summary = summarise(runs, scenario, bound.rms_at(runs.time))
    settled = runs.elapsed >= SETTLED_AFTER
    squared = (runs.error[:, settled] ** 2).sum(axis=2).mean(axis=1)
    rms, best = float(np.sqrt(squared.mean())), summary["bound"]["rms_after_1h"]
    return {
        "rms": rms,
        "bound": best,
        "ratio": rms / best,
        "nees": summary["nees_per_axis"]["mean"],
        "squared": squared.tolist(),
    }


def table(results: dict[str, dict[str, Any]], runs: int) -> str:
    """Return the table as Markdown."""
    lines = [
        f"{runs} runs of each; m, and in brackets times the bound of the same fields.",
        "",
        "| case | gravity | magnetics | both | both / better one | its bound / better one's | NEES"
        " of both |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, one in results.items():
        better = min(one["gravity"]["rms"], one["magnetics"]["rms"])
        bound = min(one["gravity"]["bound"], one["magnetics"]["bound"])
        both = one["both"]
        cells = [
            f"{one[which]['rms']:.1f} ({one[which]['ratio']:.2f})"
            for which in ("gravity", "magnetics", "both")
        ]
        shares = both["rms"] / better, both["bound"] / bound, both["nees"]
        lines.append(f"| {name} | {' | '.join([*cells, *(f'{x:.2f}' for x in shares)])} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute the cases, print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--cases", nargs="*", default=[""])
    parser.add_argument("--page", type=Path)
    told = parser.parse_args(arguments)
    results = {}
    for case in CASES:
        if not any(text in case.name for text in told.cases):
            continue
        results[case.name] = {
            name: figures(scenario, runs_of(scenario, told.runs, told.out))
            for name, scenario in scenarios(case, told.data, told.out).items()
        }
        shown = {name: round(one["rms"], 1) for name, one in results[case.name].items()}
        print(case.name, shown, flush=True)
    text = table(results, told.runs)
    print(text)
    write_atomic(told.out / "several_fields.json", json.dumps(results, indent=1))
    if told.page is not None:
        write_between(told.page, MARKS, text)


if __name__ == "__main__":
    main()
