"""What it costs that the world differs from what is assumed, row by row, untold and told.

    python benchmarks/mismatch.py --data DIR [--out DIR] [--rows TEXT ...] [--kinds KIND ...]
        [--runs 24] [--told-runs 100] [--map-errors 3e-5 0] [--workers 2]
        [--page docs/evidence/wrong-assumptions.md]

DIR of `--data` holds `se_australia_gravity.nc` and `kalgoorlie_gravity_magnetic.nc`. A row is a
closed loop of so many runs of 3.6 h with `matcher.stride=5`: `untold` with filter and matcher as
for the base, `told` with the truth for their settings, `nothing told` as `untold` without what the
base tells of the map, of biases and of barometer or log. Ratio is RMS error over the RMS bound of
that world, both over the time after the first hour. Finished parts are kept in `--out` and not
computed again; after a change of the library, begin with an empty folder."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import hashlib
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import yaml
from mismatch_maps import Maps, coarse_map
from mismatch_rows import EXACT, MGAL_3, ROWS, Row
from pages import write_between

from isogal.arrays import Array
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import summarise, write_json
from isogal.fields.scenario_map import map_for_scenario
from isogal.files import write_atomic
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario, validate_scenario
from isogal.scenario.truth import SECTIONS
from isogal.sensors.trajectory import build_trajectory

BASE = (
    "map.source={fine}",
    "matcher.stride=5",
    "gravity.field=normal",
)
"""Of every row, before its own base."""
Kind = Literal["nothing told", "untold", "told"]
"""What filter and matcher know of a row's world."""
LABELS = {"nothing told": "defaults", "untold": "base", "told": "specified"}
"""Of each kind, in tables."""
OF_THE_MAP = "matcher.map_", "matcher.bias_"
OF_AIDS = "height.bias", "height.scale", "height.weather_", "velocity.scale", "velocity.current_"
"""Keys that are left at their defaults where nothing is told; those of aids are what they are."""
CHUNK = 10
"""Runs to a job."""
MARKS = "<!-- table of benchmarks/mismatch.py -->", "<!-- end of the table -->"


def scenario_of(row: Row, kind: Kind, base: Sequence[str], maps: Maps) -> Scenario:
    """Return the scenario of a row: with its world in the section truth, or told."""
    first = maps.put_in([*BASE, *(base if row.base is None else row.base)])
    world = maps.put_in(row.world)
    if kind == "nothing told":
        world = [*(text for text in first if text.startswith(OF_AIDS)), *world]
        first = [text for text in first if not text.startswith(OF_THE_MAP + OF_AIDS)]
        if "gravity.field=map" in world:  # which is what a scenario has where it says nothing
            first.remove("gravity.field=normal")
    truth = [
        f"truth.{text}" if text.split(".")[0].split("=")[0] in SECTIONS else text for text in world
    ]
    untold = load_scenario(None, [*first, *truth])
    if kind != "told":
        return untold
    if any(text.startswith("map.") for text in world):  # the map is still what it is
        return changed(untold, maps.put_in(row.told))
    return changed(untold.informed, maps.put_in(row.told))


def changed(scenario: Scenario, settings: Sequence[str]) -> Scenario:
    """Return a scenario with some keys changed."""
    document = scenario.model_dump(mode="json")
    for text in settings:
        key, _, value = text.partition("=")
        *parents, last = key.split(".")
        target = document
        for parent in parents:
            target = target.setdefault(parent, {})
        target[last] = yaml.safe_load(value)
    return validate_scenario(document)


def some_runs(scenario: Scenario, runs: range, path: Path) -> Runs:
    """Return some runs, from the file where it is."""
    if path.exists():
        return Runs.load(path)
    result = simulate(scenario, runs)
    result.save(path)
    return result


def parts_of(scenario: Scenario, runs: int, folder: Path) -> Iterator[tuple[range, Path]]:
    text = json.dumps(scenario.model_dump(mode="json", exclude_defaults=True), sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:16]
    for first in range(0, runs, CHUNK):
        last = min(first + CHUNK, runs)
        yield range(first, last), folder / f"{name}-{first}-{last}.npz"


def bound_of(row: Row, kind: Kind, scenario: Scenario, record: Runs, maps: Maps) -> Array:
    """Return (K,) m, the RMS bound of a row's world at the times of a record."""
    known = (*row.bound, *(row.unknown if kind == "nothing told" else ()))
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    world = changed(scenario.informed, maps.put_in(known)) if known else scenario
    share = map_share(world, field_map, record)
    return posterior_cramer_rao(world, trajectory, field_map, map_share=share).rms_at(record.time)


def measured(case: "Case", scenario: Scenario, record: Runs, maps: Maps) -> dict[str, Any]:
    """Return the figures of a line."""
    bound = bound_of(case.row, case.kind, scenario, record, maps)
    summary = summarise(record, scenario, bound)
    late = record.elapsed > SETTLED_AFTER
    squared = (record.horizontal_error[:, late] ** 2).mean(axis=1)
    rms, limit = np.sqrt(squared.mean()), summary["bound"]["rms_after_1h"]
    unaided = np.sqrt((record.unaided_horizontal_error[:, late] ** 2).mean())
    return {
        "runs": len(record),
        "rms_after_1h": float(rms),
        "bound": limit,
        "unaided_after_1h": float(unaided),
        "ratio": float(rms / limit),
        "ratio_error": float(np.std(squared) / np.sqrt(len(record)) / (2.0 * rms) / limit),
        "nees": summary["nees_per_axis"]["mean"],
        "nees_all_scans": summary["nees_all_scans"]["mean"],
        "share": summary["judgement"]["share"],
        "declined": summary["fixes"]["declined"] / max(1, record.published.size),
    }


def map_share(world: Scenario, field_map: Any, record: Runs) -> Array | None:
    """Return (S,) the error of a map that says where it is how wrong, at the scans, in units of
    what the world says; None where it does not."""
    if not isinstance(getattr(field_map, "sigma", 0.0), np.ndarray):
        return None
    there = field_map.sigma_at(record.latitude[1:], record.longitude[1:])
    return np.asarray(there) / world.map_error.sigma


HEAD = (
    "| what differs | | runs | RMS after 1 h (m) | bound (m) | ratio | unaided (m) | NEES after"
    " fixes | NEES at all scans | worse than unaided | beyond 5 claimed sigmas | good |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def line(name: str, kind: str, it: dict[str, Any]) -> str:
    """Return a line of the table."""
    share = {key: f"{100 * value:.0f} %" for key, value in it["share"].items()}
    cells = (
        name, kind, str(it["runs"]), f"{it['rms_after_1h']:.1f}", f"{it['bound']:.1f}",
        f"{it['ratio']:.2f} ± {it['ratio_error']:.2f}", f"{it['unaided_after_1h']:.0f}",
        number(it["nees"]), number(it["nees_all_scans"]), share["worse_than_unaided"],
        share["overconfident"], share["good"],
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def label(row: Row, kind: Kind) -> str:
    """Return what the second column says."""
    return LABELS[kind] if row.untold or kind == "nothing told" else ""


def number(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.2f}" if value < 9.95 else f"{value:.0f}"


def table(results: dict[str, dict[str, Any]], base: str) -> str:
    """Return the table of one base, in the order of the rows."""
    lines = [HEAD]
    for row in ROWS:
        for kind in get_args(Kind):
            if it := results.get(f"{row.name}, {kind}, {base}"):
                lines.append(line(row.name, label(row, kind), it))
    return "\n".join(lines)


@dataclass(frozen=True)
class Case:
    """A line of the table."""

    row: Row
    kind: Kind
    base: tuple[str, ...]
    base_name: str
    runs: int

    @property
    def name(self) -> str:
        """What its results are kept as."""
        return f"{self.row.name}, {self.kind}, {self.base_name}"

    def scenario(self, maps: Maps) -> Scenario:
        return scenario_of(self.row, self.kind, self.base, maps)


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """Yield the lines that are asked for, in the order of the rows."""
    for error in options.map_errors:
        base = EXACT if error == 0.0 else tuple(s.replace("3e-5", f"{error:g}") for s in MGAL_3)
        name = "exact map" if error == 0.0 else f"map {error * 1e5:g} mGal wrong"
        for row in ROWS:
            if options.rows and not any(text in row.name for text in options.rows):
                continue
            if row.base and error == 0.0:
                continue
            there = {"nothing told": True, "untold": row.untold, "told": row.tellable}
            for kind in options.kinds or get_args(Kind):
                if there[kind]:
                    runs = options.told_runs if kind == "told" else options.runs
                    yield Case(row, kind, base, name, runs)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what says which lines, from what data, and where results are kept."""
    parser.add_argument("--data", type=Path, required=True, help="folder of the maps")
    parser.add_argument("--out", type=Path, default=Path("out/mismatch"), help="kept there")
    parser.add_argument("--rows", nargs="+", metavar="TEXT", help="rows with TEXT in their name")
    parser.add_argument("--kinds", nargs="+", choices=get_args(Kind), help="default: all")
    parser.add_argument("--runs", type=int, default=24, help="of rows that are not told")
    parser.add_argument("--told-runs", type=int, default=100)
    parser.add_argument("--map-errors", type=float, nargs="+", default=[3e-5], metavar="M/S²")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path, help="page whose table is replaced")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_options(parser)
    options = parser.parse_args()
    maps = coarse_map(options.data, options.out)
    path = options.out / "results.json"
    results: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    with ProcessPoolExecutor(options.workers) as pool:
        for case in cases(options):
            if results.get(case.name, {}).get("runs", 0) < case.runs:
                scenario = case.scenario(maps)
                parts = list(parts_of(scenario, case.runs, options.out / "parts"))
                one = partial(some_runs, scenario)
                record = Runs.concatenate(list(pool.map(one, *zip(*parts, strict=True))))
                results[case.name] = measured(case, scenario, record, maps)
                write_json(path, results)
            print(line(case.name, "", results[case.name]), flush=True)
    bases = dict.fromkeys(name.rpartition(", ")[2] for name in results)
    text = "\n\n".join(f"{base[0].upper()}{base[1:]}:\n\n{table(results, base)}" for base in bases)
    write_atomic(options.out / "table.md", text + "\n")
    print(text)
    if options.page:
        write_between(options.page, MARKS, text)


if __name__ == "__main__":
    main()
