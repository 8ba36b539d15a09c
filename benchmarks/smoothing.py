"""What all data of a voyage say of each of its states, beside the bound of smoothing and the error
of the time.

    python benchmarks/smoothing.py --data DIR [--out DIR] [--runs 12] [--compared-runs 4]
        [--late-runs 4] [--workers 2] [--rows TEXT ...] [--page docs/evidence/smoothing.md]

The rows are the README's twelve with nothing told, and starts that the navigator is unsure of, or
wrong about, for which the bound is that of one who knows how wrong it may be (DIR holds
`se_australia_gravity.nc`). Errors and bounds are RMS over whole runs, the
beginning included. Ratios have the standard error over runs. Runs that are in `--out` are not
computed again; after a change of the library, begin with an empty folder.

What runs differ by is mostly chance that no estimator can help. So some are smoothed by the
readings as well (`linear_navigator`). Not where the start is uncertain by kilometres."""

import argparse
import math
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from pathlib import Path

import acceptance_rows
import closed_loop
import numpy as np
from acceptance_rows import Place, Row
from linear_navigator import linear_navigator, paired

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.records import Runs
from isogal.fields.scenario_map import maps_for_scenario
from isogal.files import atomic_path
from isogal.montecarlo.engine import simulate
from isogal.navigator import Navigator
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory

MARKS = closed_loop.marks_of(__file__)
LAG = 300.0
"""s, the other lag."""
NOT_LINEAR = 1000.0
"""m; starts of the rows are known to 50 m, or uncertain by 5 km and more."""
SEED = 0
CHUNK = 2
"""Runs to a job."""
COLUMNS = {
    "at the time (m)": "{causal:.1f}",
    "smoothed (m)": "{rms:.1f}",
    "of that": "{of_causal:.2f}",
    "300 s later, of that": "{of_causal_late:.2f}",
    "bound of smoothing (m)": "{bound:.1f}",
    "ratio to it": "{ratio:.2f} ± {ratio_error:.2f}",
    "linear smoother (m)": "{linear:.1f}",
    "ratio to that": "{paired:.3f} ± {paired_error:.3f}",
    "NEES": "{nees:.2f}",
    "NEES at the time": "{nees_causal:.2f}",
}


def rows() -> list[Row]:
    """Return what is simulated."""
    starts = [row for row in acceptance_rows.of_gravity() if "start" in row.name]
    return [*acceptance_rows.of_the_readme("nothing told"), *starts]


def some_runs(scenario: Scenario, part: range, path: Path, compared: int) -> tuple[Runs, Array]:
    """Return some runs, smoothed; and of those whose number is below `compared` the squared error
    (m², mean over the run) when smoothed by readings, with the errors of map and instrument told.
    Both are from their files where they are there."""
    told = path.with_suffix(".told.npy")
    if path.exists() and told.exists():
        return Runs.load(path), np.load(told)
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    index = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
    time, truth = trajectory.time[index], (trajectory.latitude[index], trajectory.longitude[index])
    squared: list[float] = []

    def compare(run: int, navigator: Navigator) -> None:
        if part[run] >= compared:
            return
        linear = linear_navigator(scenario, trajectory, maps, navigator)
        assert linear is not None
        states = linear.smoothed(time)
        place = np.array([state.position[:2] for state in states]).T
        squared.append(2.0 * closed_loop.rms(np.array(horizontal_difference(*place, *truth))) ** 2)

    record = simulate(scenario, part, maps, lag=math.inf, finished=compare)
    record.save(path)
    with atomic_path(told) as temporary:
        np.save(temporary, squared)
    return record, np.array(squared)


def figures_of(
    scenario: Scenario, options: argparse.Namespace, pool: Executor
) -> closed_loop.Figures:
    """Return the figures of runs of a scenario; see `COLUMNS`."""
    compared = 0 if _unsure_of_start(scenario) else options.compared_runs
    parts = closed_loop.parts_of(scenario, options.runs, options.out, CHUNK, math.inf)
    compute = partial(some_runs, scenario, compared=compared)
    records, told = zip(*pool.map(compute, *zip(*parts, strict=True)), strict=True)
    record = Runs.concatenate(records)
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    limit = posterior_cramer_rao(_unsure(scenario).true, trajectory, maps, smoothed=True)
    bound = closed_loop.rms(limit.smoothed_rms_at(record.time))
    states = record.smoothed
    assert states is not None
    squared = (states.horizontal_error**2).mean(axis=1)
    rms, causal = float(np.sqrt(squared.mean())), closed_loop.rms(record.horizontal_error)
    return {
        "causal": causal,
        "rms": rms,
        "of_causal": rms / causal,
        "of_causal_late": _of_causal_late(scenario, options, pool),
        "bound": bound,
        "ratio": rms / bound,
        "ratio_error": float(squared.std() / np.sqrt(len(record)) / (2.0 * rms) / bound),
        **paired(squared, np.concatenate(told)[:compared]),
        "nees": float(np.mean(nees_per_axis(states.error, states.covariance))),
        "nees_causal": float(np.mean(nees_per_axis(record.error, record.covariance))),
    }


def _of_causal_late(scenario: Scenario, options: argparse.Namespace, pool: Executor) -> float:
    """Return the error of states by the data up to `LAG` after them as share of that at the time;
    NaN where no such runs are asked for."""
    if options.late_runs == 0:
        return math.nan
    late = closed_loop.kept_runs(scenario, options.late_runs, options.out, pool, CHUNK, LAG)
    assert late.smoothed is not None
    return closed_loop.rms(late.smoothed.horizontal_error) / closed_loop.rms(late.horizontal_error)


def _unsure_of_start(scenario: Scenario) -> bool:
    """Whether the start may be wrong by kilometres."""
    initial = scenario.initial_error
    return math.hypot(initial.position, initial.hidden_position) > NOT_LINEAR


def _unsure(scenario: Scenario) -> Scenario:
    """Return a scenario whose navigator knows how wrong its start may be."""
    initial = scenario.initial_error
    if initial.hidden_position == 0.0:
        return scenario
    position = math.hypot(initial.position, initial.hidden_position)
    known = {"position": position, "hidden_position": 0.0}
    return scenario.model_copy(update={"initial_error": initial.model_copy(update=known)})


def table(options: argparse.Namespace) -> str:
    """Simulate the rows, print them one by one, and return the table."""
    place = Place(options.data, options.out, seed=SEED)
    lines = [closed_loop.head_of(["row", *COLUMNS])]
    print(lines[0], flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for row in rows():
            if not closed_loop.containing(row.name, options.rows):
                continue
            scenario = acceptance_rows.scenario_of(row, place)
            figures = figures_of(scenario, options, pool)
            cells = closed_loop.cells_of(figures, COLUMNS)
            lines.append(closed_loop.line_of([row.name.removesuffix(", nothing told"), *cells]))
            print(lines[-1], flush=True)
    return "\n".join(lines)


def main() -> None:
    """Make the table."""
    names = ("data", "workers", "rows", "page")
    parser = closed_loop.parser(__doc__, *names, runs=12, out=Path("out/smoothing"))
    parser.add_argument("--compared-runs", type=int, default=4, help="with the linear smoother")
    parser.add_argument("--late-runs", type=int, default=4, help="runs of the other lag")
    options = parser.parse_args()
    made = table(options)
    text = (
        f"{options.runs} runs a row, {options.late_runs} of the column *300 s later*,"
        f" {options.compared_runs} compared with the linear smoother.\n\n{made}"
    )
    closed_loop.write_between(options.page, MARKS, text, seed=SEED)


if __name__ == "__main__":
    main()
