"""Accuracy, honesty and cost in one table, beside the one that was kept: `make accept`.

    python benchmarks/acceptance.py [--quick] [--rows TEXT ...] [--data DIR] [--matcher NAME]
        [--seed 7001] [--runs N] [--workers 2] [--set KEY=VALUE ...] [--again] [--keep]
        [--json FILE]

RMS errors and their bound are of the time after the first hour (beams and magnetic aircraft: ten
minutes), NEES is per axis after each fix. `pair` is the RMS over the kept one of the same runs,
which is known far better than either; with another seed, of other runs. Of recorded lines all are
medians, and the bound is the median 1-sigma. `> 5σ` counts runs beyond five of their own sigmas
for ten minutes. Times are CPU times of one thread; where other programs share the caches they are
longer.

Exits with 1 where a row is worse than the kept one, by what `acceptance_figures.py` says, or has
failed. Finished rows are kept in build/acceptance, by the library's source, and not computed again
(--again: they are). --keep writes
benchmarks/acceptance.json: commit it with the change that has moved the figures, and say there
why."""

import argparse
import hashlib
import json
import math
import multiprocessing
import re
import resource
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import TypeVar
from unittest.mock import patch

import closed_loop
from acceptance_figures import Cost, RowFigures, compared, figures_of, figures_of_lines
from acceptance_rows import Place, Row, Tracks, all_rows, scenario_of
from acceptance_table import line_of, print_table
from measured_data.untold import group_of, matched

import isogal
from isogal.evaluation.records import Runs
from isogal.evaluation.results import write_json
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.field_map import FieldMap
from isogal.matching import map_matching
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.matching.registry import build_run_matcher
from isogal.montecarlo import engine
from isogal.scenario import Scenario

ROOT = Path(__file__).resolve().parents[1]
KEPT = Path(__file__).with_name("acceptance.json")
FORMAT = 2
"""Of the figures: another one makes all rows anew."""
QUICK_RUNS, CHUNK = 10, 10
"""Runs of a row of --quick, and at most to a job."""
_warm: set[str] = set()
Memory = TypeVar("Memory")


def version() -> str:
    """Return what stands for the library's source."""
    return closed_loop.of_source(str(FORMAT), [Path(isogal.__file__).parent])[:12]


class Counting:
    """A matcher, and how many times it has told a navigator that it has diverged."""

    def __init__(self, matcher: Matcher) -> None:
        self.matcher, self.resets = matcher, 0

    def __getattr__(self, name: str):
        return getattr(self.matcher, name)

    def match(self, batch: Batch, field_map: FieldMap, memory: Memory) -> tuple[Fix, Memory]:
        """Match one batch; see `isogal.matching.interfaces.Matcher`."""
        fix, after = self.matcher.match(batch, field_map, memory)
        self.resets += fix.reset
        return fix, after


def simulated(scenario: Scenario, runs: range) -> tuple[Runs, Cost]:
    """Return some runs and what they took, without what a process does once (loading compiled
    functions); the time of a fix is CPU time."""
    maps, key = maps_for_scenario(scenario), scenario.model_dump_json()
    if key not in _warm:
        engine.simulate(scenario, runs[:1], maps)
        _warm.add(key)
    with patch.object(map_matching, "clock", SimpleNamespace(perf_counter=time.thread_time)):
        start, matcher = time.process_time(), Counting(build_run_matcher(scenario))
        record = engine.simulate(scenario, runs, maps, matcher)
        return record, Cost(time.process_time() - start, _peak(), matcher.resets)


def _peak() -> float:
    """Return the peak memory of this process, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _named(name: str) -> Row | Tracks:
    """Return a row in a worker, where it is looked up, since what makes it cannot be sent
    there."""
    return next(row for row in all_rows() if row.name == name)


def _lines(name: str, place: Place) -> RowFigures:
    """Return the figures of recorded lines."""
    group = group_of(_named(name).group, place.data)
    start = time.thread_time()
    found = matched(*group, **({"name": place.matcher} if place.matcher else {}))
    seconds = time.thread_time() - start
    return figures_of_lines(found, seconds, Cost(seconds, _peak()))


def _scenario(name: str, place: Place) -> Scenario:
    return scenario_of(_named(name), place)


def _figures(
    name: str, place: Place, scenario: Scenario, parts: Sequence[tuple[Runs, Cost]]
) -> RowFigures:
    """Return the figures of runs that were simulated in parts."""
    row, record = _named(name), Runs.concatenate([part for part, _ in parts])
    costs = [cost for _, cost in parts]
    cost = Cost(
        sum(one.cpu for one in costs),
        max(one.memory for one in costs),
        sum(one.resets for one in costs),
    )
    return figures_of(row, scenario, record, row.bound(scenario, record, place), cost)


def measure(row: Row | Tracks, place: Place, runs: int, pool: Executor) -> RowFigures:
    """Return the figures of a row, or in one line why there are none."""
    missing = [name for name in row.needs if not (place.data / name).exists()]
    if missing:
        return {"skipped": f"no {', '.join(missing)} in the folder of the data"}
    try:
        if isinstance(row, Tracks):
            return pool.submit(_lines, row.name, place).result()
        scenario = pool.submit(_scenario, row.name, place).result()
        step = min(CHUNK, math.ceil(runs / 2))
        chunks = [range(k, min(k + step, runs)) for k in range(0, runs, step)]
        jobs = [pool.submit(simulated, scenario, chunk) for chunk in chunks]
        parts = [job.result() for job in jobs]
        return pool.submit(_figures, row.name, place, scenario, parts).result()
    except Exception as error:
        return {"failed": " ".join(f"{type(error).__name__}: {error}".split())}


def kept_or_measured(
    row: Row | Tracks, place: Place, runs: int, options: argparse.Namespace
) -> RowFigures:
    """Return the figures of a row, from the file where it is; each row has processes of its own,
    so that its memory is its own and none dies of another."""
    text = ", ".join([row.name, f"{place.matcher}", *place.changes, f"{place.seed}", f"{runs}"])
    path = place.out / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.json"
    if path.exists() and not options.again:
        return json.loads(path.read_text(encoding="utf-8"))["figures"]
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(options.workers, mp_context=context) as pool:
        found = measure(row, place, runs, pool)
    if "rms" in found:
        write_json(path, {"row": text, "figures": found})
    return found


def chosen(options: argparse.Namespace) -> Iterator[tuple[Row | Tracks, int]]:
    """Yield the rows that are asked for, and how many runs of each."""
    for row in all_rows():
        wanted = not options.rows or any(re.search(text, row.name) for text in options.rows)
        if wanted and (row.quick or not options.quick):
            runs = options.runs or row.runs
            yield row, min(runs, QUICK_RUNS) if options.quick else runs


def arguments(given: Sequence[str] | None) -> argparse.Namespace:
    parser = closed_loop.parser(__doc__, "workers", "set")
    add = parser.add_argument
    add("--quick", action="store_true", help="fewer rows and runs: ten minutes")
    add("--rows", nargs="+", metavar="TEXT", help="rows in whose name the pattern is found")
    add(
        "--data",
        type=closed_loop.folder,
        default=ROOT.parent / "shared" / "data",
        help="folder of the data",
    )
    add("--matcher", metavar="NAME", help="another one than the default")
    add("--seed", type=int, default=7001)
    add("--runs", type=int, help="of each row")
    add("--again", action="store_true", help="compute rows that are there already")
    add("--keep", action="store_true", help="write benchmarks/acceptance.json")
    add("--json", type=Path, metavar="FILE", help="write the figures there")
    options = parser.parse_args(given)
    if options.keep and (options.quick or options.set):
        parser.error("--keep: keeps rows of the whole table, without --quick and --set")
    return options


def main(given: Sequence[str] | None = None) -> None:
    """Measure, compare, print."""
    options = arguments(given)
    out = ROOT / "build" / "acceptance" / version()
    place = Place(options.data.resolve(), out, options.seed, options.matcher, tuple(options.set))
    kept: dict[str, RowFigures] = json.loads(KEPT.read_text(encoding="utf-8"))["rows"]
    now: dict[str, RowFigures] = {}
    for row, runs in chosen(options):
        start = time.monotonic()
        now[row.name] = kept_or_measured(row, place, runs, options)
        print(line_of(row.name, now[row.name], time.monotonic() - start), flush=True)
        if options.keep and "rms" in now[row.name]:
            keep(now)
    if options.json:
        write_json(options.json, {"rows": now})
    if not now:
        sys.exit("no row has that in its name")
    print_table(now, kept)
    both = [compared(figures, kept.get(name)) for name, figures in now.items()]
    failed = any("failed" in figures for figures in now.values())
    if failed or (not options.keep and any(one and one.worse for one in both)):
        sys.exit(1)


def keep(now: Mapping[str, RowFigures]) -> None:
    """Write the rows that have figures among those that are kept, in the order of the table."""
    document = json.loads(KEPT.read_text(encoding="utf-8"))
    new = document["rows"] | {name: one for name, one in now.items() if "rms" in one}
    order = [row.name for row in all_rows() if row.name in new]
    write_json(KEPT, document | {"rows": {name: new[name] for name in order}})


if __name__ == "__main__":
    main()
