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

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import closed_loop
import numpy as np
import yaml
from mismatch_maps import Maps, coarse_map
from mismatch_rows import EXACT, MGAL_3, ROWS, Row

from isogal.arrays import Array
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.records import Runs
from isogal.evaluation.results import write_json
from isogal.fields.scenario_map import map_for_scenario
from isogal.files import write_atomic
from isogal.maps.channels import RouteMap
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
MARKS = closed_loop.marks_of(__file__)
COLUMNS = {
    "runs": "{runs}",
    "RMS after 1 h (m)": "{rms:.1f}",
    "bound (m)": "{bound:.1f}",
    "ratio": "{ratio:.2f} ± {ratio_error:.2f}",
    "unaided (m)": "{unaided:.0f}",
    "NEES after fixes": "{nees:.2f}",
    "NEES at all scans": "{nees_all_scans:.2f}",
    "worse than unaided": "{worse_than_unaided_percent:.0f} %",
    "beyond 5 claimed sigmas": "{overconfident_percent:.0f} %",
    "good": "{good_percent:.0f} %",
}


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
    return changed(untold.true.informed, maps.put_in(row.told))


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


def bound_of(row: Row, kind: Kind, scenario: Scenario, record: Runs, maps: Maps) -> Array:
    """Return (K,) m, the RMS bound of a row's world at the times of a record."""
    known = (*row.bound, *(row.unknown if kind == "nothing told" else ()))
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    world = changed(scenario.true.informed, maps.put_in(known)) if known else scenario
    share = map_share(world, field_map, record)
    bound = posterior_cramer_rao(world.true, trajectory, field_map, map_share=share)
    return bound.rms_at(record.time)


def map_share(world: Scenario, field_map: RouteMap, record: Runs) -> Array | None:
    """Return (S,) the error of a map that says where it is how wrong, at the scans, in units of
    what the world says; None where it does not."""
    if not isinstance(getattr(field_map, "sigma", 0.0), np.ndarray):
        return None
    there = field_map.sigma_at(record.latitude[1:], record.longitude[1:])
    return np.asarray(there) / world.map_error.sigma


def label(row: Row, kind: Kind) -> str:
    """Return what the second column says."""
    return LABELS[kind] if row.untold or kind == "nothing told" else ""


def table(results: dict[str, closed_loop.Figures], base: str) -> str:
    """Return the table of one base, in the order of the rows."""
    rows = (
        [row.name, label(row, kind), *closed_loop.cells_of(found, COLUMNS)]
        for row in ROWS
        for kind in get_args(Kind)
        if (found := results.get(f"{row.name}, {kind}, {base}"))
    )
    return closed_loop.markdown(("what differs", "", *COLUMNS), rows)


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
            if not closed_loop.containing(row.name, options.rows):
                continue
            if row.base and error == 0.0:
                continue
            there = {"nothing told": True, "untold": row.untold, "told": row.tellable}
            for kind in options.kinds or get_args(Kind):
                if there[kind]:
                    runs = options.told_runs if kind == "told" else options.runs
                    yield Case(row, kind, base, name, runs)


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser of what says which lines, from what data, and where results are kept."""
    out = Path("out/mismatch")
    parser = closed_loop.parser(doc, "data", "rows", "workers", "page", out=out, runs=24)
    parser.add_argument("--kinds", nargs="+", choices=get_args(Kind), help="default: all")
    parser.add_argument("--told-runs", type=int, default=100, help="of rows that are told")
    parser.add_argument("--map-errors", type=float, nargs="+", default=[3e-5], metavar="M/S²")
    return parser


def main() -> None:
    """Measure and print."""
    options = parser_of(__doc__).parse_args()
    maps = coarse_map(options.data, options.out)
    path = options.out / "results.json"
    results = json.loads(path.read_text()) if path.exists() else {}
    with ProcessPoolExecutor(options.workers) as pool:
        for case in cases(options):
            if results.get(case.name, {}).get("runs", 0) < case.runs:
                scenario = case.scenario(maps)
                record = closed_loop.kept_runs(scenario, case.runs, options.out / "parts", pool)
                bound = bound_of(case.row, case.kind, scenario, record, maps)
                results[case.name] = closed_loop.figures_of(scenario, record, bound)
                write_json(path, results)
            cells = closed_loop.cells_of(results[case.name], COLUMNS)
            print(closed_loop.line_of([case.name, *cells]), flush=True)
    bases = dict.fromkeys(name.rpartition(", ")[2] for name in results)
    text = "\n\n".join(f"{base[0].upper()}{base[1:]}:\n\n{table(results, base)}" for base in bases)
    write_atomic(options.out / "table.md", text + "\n")
    print(text)
    closed_loop.write_between(options.page, MARKS, text)


if __name__ == "__main__":
    main()
