"""Satellites for an hour, then none: what is left of them beside the bound of that world.

    python benchmarks/voyage.py --data DIR [--runs 40] [--compared-runs 8] [--workers 2]
        [--rows TEXT ...] [--page docs/evidence/voyage.md]

The README's rows with a satellite receiver that works for the first hour of 3.6; and what readings
show while it does of an instrument that is late or has a filter, which nobody has told: beside the
bound of a navigator that knows it. Errors are of the time without satellites, which is that after
the first hour. Some runs are compared with a linear navigator (`linear_navigator`) as well, which
has the same chance in it; not where readings are late, which it does not model."""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import closed_loop  # first: it asks NumPy for one thread
import numpy as np
from acceptance_rows import AUSTRALIA, GOOD, MAPS, READINGS
from linear_navigator import linear_navigator, paired

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.evaluation.results import write_json
from isogal.fields.scenario_map import maps_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.navigator import Navigator
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

MARKS = closed_loop.marks_of(__file__)
SATELLITES = ["gnss.available=[[0, 3600]]"]
CHUNK = 4
"""Runs to a job."""
LEARNT = {
    "low-pass of 30 s": ["truth.gravimeter.filter_time=30"],
    "late by 20 s": ["truth.gravimeter.delay=20"],
    "clock off by 2 s": ["truth.gravimeter.delay=2"],
}
COLUMNS = {
    "RMS, m": "{rms:.1f}",
    "bound, m": "{bound:.1f}",
    "ratio": "{ratio:.2f} ± {ratio_error:.2f}",
    "linear navigator, m": "{linear:.1f}",
    "ratio to that": "{paired:.3f} ± {paired_error:.3f}",
    "NEES": "{nees_settled:.2f}",
    "unaided INS, m": "{unaided:.0f}",
    "ms a fix": "{fix_ms:.1f}",
}


def cases(data: str, seed: int) -> dict[tuple[str, ...], Scenario]:
    """Return the scenario of each row."""
    common = [f"map.source={data}", f"seed={seed}", *SATELLITES]
    found = {
        (f"{name}, map {error}", "nothing told"): load_scenario(None, [*readings, *wrong, *common])
        for error, (wrong, _) in MAPS.items()
        for name, readings in READINGS.items()
    }
    return found | {
        (f"gravity 1 mGal, {name}", "nothing told"): load_scenario(None, [*GOOD, *keys, *common])
        for name, keys in LEARNT.items()
    }


def some_runs(scenario: Scenario, part: range, compared: int) -> tuple[Runs, Array]:
    """Return some runs; and of those whose number is below `compared` the squared error (m², mean
    over the time without satellites) of a linear navigator."""
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    index = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
    index = index[trajectory.time[index] - trajectory.time[0] > SETTLED_AFTER]
    truth = trajectory.latitude[index], trajectory.longitude[index]
    squared: list[float] = []

    def compare(run: int, navigator: Navigator) -> None:
        if part[run] >= compared:
            return
        linear = linear_navigator(scenario, trajectory, maps, navigator)
        if linear is not None:
            place = linear.track(trajectory.time[index])[:, :2].T
            squared.append(2.0 * closed_loop.rms(horizontal_difference(*place, *truth)) ** 2)

    wanted = compare if part[0] < compared else None
    return simulate(scenario, part, maps, finished=wanted), np.array(squared)


def row_of(
    scenario: Scenario, runs: int, compared: int, pool: ProcessPoolExecutor
) -> closed_loop.Figures:
    """Return the figures of a row; see `COLUMNS`."""
    parts = [range(k, min(k + CHUNK, runs)) for k in range(0, runs, CHUNK)]
    found = pool.map(partial(some_runs, scenario, compared=compared), parts)
    records, linear = zip(*found, strict=True)
    record = Runs.concatenate(records)
    late = record.elapsed > SETTLED_AFTER
    squared = (record.horizontal_error[:, late] ** 2).mean(axis=1)
    figures = closed_loop.figures_of(scenario, record, closed_loop.bound_of(scenario, record))
    return figures | paired(squared, np.concatenate(linear))


def main() -> None:
    """Run it."""
    options = closed_loop.parser(__doc__, "data", "page", "rows", "workers", runs=40)
    options.add_argument("--compared-runs", type=int, default=8, help="with the linear navigator")
    options.add_argument("--seed", type=int, default=20261)
    options.add_argument("--out", type=Path, help="folder of the results")
    asked = options.parse_args()
    rows = cases(str(asked.data / AUSTRALIA), asked.seed)
    wanted = {
        names: one for names, one in rows.items() if closed_loop.containing(names[0], asked.rows)
    }
    lines, results = [closed_loop.head_of(["readings", "told", *COLUMNS])], {}
    print(lines[0], flush=True)
    with ProcessPoolExecutor(asked.workers) as pool:
        for names, scenario in wanted.items():
            found = row_of(scenario, asked.runs, asked.compared_runs, pool)
            results[", ".join(names)] = found
            lines.append(closed_loop.line_of([*names, *closed_loop.cells_of(found, COLUMNS)]))
            print(lines[-1], flush=True)
            if asked.out:
                write_json(asked.out / "results.json", results)
    table = "\n".join(lines)
    text = f"{asked.runs} runs a row, {asked.compared_runs} compared with the linear navigator."
    closed_loop.write_between(asked.page, MARKS, f"{text}\n\n{table}", seed=asked.seed)


if __name__ == "__main__":
    main()
