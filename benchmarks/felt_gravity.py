"""The paper's rows in its own world, and in one where the IMU senses the real gravity vector.

    python benchmarks/felt_gravity.py --map FILE [--runs 24] [--workers 2]
        [--page docs/evidence/gravity-vector.md]

Standard aiding every 30 scans on an exact map, as in the paper. Prints a table of RMS errors, and
puts it into a page between its marks."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from pages import write_between

from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import summarise
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario

ROWS = {
    "gravity, 1 mGal": ("gravimeter.quantity=gravity", "gravimeter.sigma=1e-5"),
    "gravity, 20 mGal": ("gravimeter.quantity=gravity", "gravimeter.sigma=2e-4"),
    "disturbance, 0.1 mGal": ("gravimeter.quantity=disturbance", "gravimeter.sigma=1e-6"),
    "disturbance, 4 mGal": ("gravimeter.quantity=disturbance", "gravimeter.sigma=4e-5"),
}
MATCHERS = ("pmht-paper", "pmht")
WORLDS = {
    "normal gravity": ("gravity.field=normal",),
    "sensed, compensated": ("gravity.field=map",),
    "sensed, not compensated, specified": (
        "gravity.field=map",
        "gravity.compensation=none",
    ),
    "sensed, not specified": ("gravity.field=normal", "truth.gravity.field=map"),
}
COMMON = ("matcher.batch_length=30", "matcher.stride=30", "matcher.map_sigma=0")
CHUNK = 6
"""Runs of a job."""
MARKS = "<!-- table of benchmarks/felt_gravity.py -->", "<!-- end of the table -->"
HEAD = (
    "| readings | matcher | world | unaided (m) | RMS after 1 h (m) | NEES at all scans | good |\n"
    "|---|---|---|---|---|---|---|"
)


def line(row: str, matcher: str, world: str, scenario: Scenario, record: Runs) -> str:
    """Return a line of the table."""
    late = record.elapsed > SETTLED_AFTER
    unaided, aided = (
        np.sqrt((error[:, late] ** 2).mean())
        for error in (record.unaided_horizontal_error, record.horizontal_error)
    )
    summary = summarise(record, scenario, np.full(len(record.time), np.nan))
    nees, share = summary["nees_all_scans"]["mean"], summary["judgement"]["share"]["good"]
    return (
        f"| {row} | `{matcher}` | {world} | {unaided:.0f} | {aided:.1f} | {nees:.3g} |"
        f" {100 * share:.0f} % |"
    )


def lines(runs: int, map_file: str, pool: ProcessPoolExecutor) -> Iterator[str]:
    """Measure all cases, and yield a line for each."""
    for row, readings in ROWS.items():
        for matcher in MATCHERS:
            for world, gravity in WORLDS.items():
                settings = [*COMMON, *readings, *gravity, f"matcher.name={matcher}"]
                scenario = load_scenario(None, [*settings, f"map.source={map_file}"])
                parts = [range(k, min(k + CHUNK, runs)) for k in range(0, runs, CHUNK)]
                record = Runs.concatenate(list(pool.map(partial(simulate, scenario), parts)))
                yield line(row, matcher, world, scenario, record)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--map", required=True, help="of gravity and the disturbance")
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path, help="page whose table is replaced")
    options = parser.parse_args()
    found = [f"{options.runs} runs of each:", "", HEAD]
    print(HEAD)
    with ProcessPoolExecutor(options.workers) as pool:
        for text in lines(options.runs, options.map, pool):
            found.append(text)
            print(text, flush=True)
    if options.page:
        write_between(options.page, MARKS, "\n".join(found))


if __name__ == "__main__":
    main()
