"""How often the error exceeds the protection level at 0.1, 0.01 and 0.001 per hour.

    python benchmarks/integrity.py --data DIR [--out DIR] [--run-hours 20000] [--mismatch]
        [--rows TEXT ...] [--runs 24] [--told-runs 100] [--map-errors 3e-5 0]
        [--workers 2] [--page docs/evidence/protection-level.md]
        [--figure docs/figures/stanford.png]

Run-hours are of the row "nothing" of `mismatch.py` (a map 3 mGal wrong, told), in runs of 3.6 h;
`--mismatch` adds its other rows, told and untold. Parts of ten runs are taken from its folder
`--out` where they are there, else computed. After a change of the library, begin with an empty
folder."""

import argparse
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import get_args

import closed_loop
import mismatch
import numpy as np
from mismatch_maps import coarse_map
from mismatch_rows import ROWS

from isogal.arrays import Array
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.figures import style
from isogal.evaluation.figures.errors import stanford_figure
from isogal.evaluation.integrity import (
    RISKS,
    Rate,
    correlation_time,
    exceedances,
    hours,
    in_sigmas,
    level_of,
)
from isogal.evaluation.records import Runs
from isogal.files import write_atomic
from isogal.scenario import Integrity, Scenario

MARKS = closed_loop.marks_of(__file__)
HOURS = 3.6
"""Of a run."""
SHOWN = 10
"""Parts in the figure."""
THINNED = 5
"""States to one whose squared error the tails are fitted to."""
HEAD = (
    *("what differs", "", "run-hours", "correlation time (s)", "factor, freedom"),
    *("median level (m)", "in 1-sigmas", *(f"events at {risk:g} per hour" for risk in RISKS)),
)


@dataclass(frozen=True)
class Count:
    """Figures of a part of the runs."""

    hours: float
    events: dict[float, int]
    """By risk per hour."""
    levels: Array
    """m, at the settings' risk."""
    sigmas: Array
    """The same in 1-sigmas."""
    time: float
    """Correlation time, s."""
    squares: Array
    """e' P^-1 e of some states."""

    @classmethod
    def of(cls, part: Runs, settings: Integrity) -> "Count":
        """Count a part."""
        level, some = level_of(part, settings), slice(None, None, THINNED)
        nees = nees_per_axis(part.error[:, some], part.covariance[:, some])
        return cls(
            hours(part),
            {risk: exceedances(part, settings, risk).events for risk in RISKS},
            level.ravel().astype(np.float32),
            in_sigmas(level, part).ravel().astype(np.float32),
            correlation_time(part),
            2.0 * nees[np.isfinite(nees)],
        )


def line_of(name: str, kind: str, counts: Sequence[Count]) -> str:
    """Return a line of the table."""
    hours = sum(one.hours for one in counts)
    level, sigmas, squares = (
        np.concatenate([getattr(one, part) for one in counts])
        for part in ("levels", "sigmas", "squares")
    )
    rates = (cell(Rate(sum(one.events[risk] for one in counts), hours), risk) for risk in RISKS)
    factor, freedom = tails(squares)
    words = f"{freedom:.0f}" if freedom < 1000.0 else "Gaussian"
    time = np.nanmedian([one.time for one in counts])
    numbers = f"{hours:.0f}", f"{time:.0f}", f"{factor:.2f}, {words}"
    middles = f"{np.median(level):.0f}", f"{np.median(sigmas):.2f}"
    return closed_loop.line_of([name, kind, *numbers, *middles, *rates])


def tails(squares: Array) -> tuple[float, float]:
    """Return the factor on the covariance, and the degrees of freedom, of the bivariate t
    distribution that values of e' P^-1 e fit best (maximum likelihood, as if independent)."""
    from scipy.optimize import minimize

    def negative(logarithms: Array) -> float:
        factor, freedom = np.exp(logarithms)
        likelihood = (freedom / 2.0 + 1.0) * np.log1p(squares / factor / freedom)
        return float(np.log(factor) + likelihood.mean())

    bounds = [(-5.0, 10.0), (0.0, 9.0)]
    best = minimize(negative, [0.0, 4.0], method="Nelder-Mead", bounds=bounds)
    factor, freedom = np.exp(best.x)
    return float(factor), float(freedom)


def picture(parts: Sequence[Runs], settings: Integrity) -> bytes:
    """Return the Stanford diagram of a row's first parts as PNG."""
    return style.png(stanford_figure(Runs.concatenate(parts), settings))


def cell(rate: Rate, allowed: float) -> str:
    """Return count, rate and interval; in bold where events come more often than allowed."""
    low, high = rate.interval
    text = f"{rate.events}: {rate.per_hour:.2g} ({low:.2g} to {high:.2g})"
    return f"**{text}**" if rate.verdict(allowed) == "more often" else text


def parts_of(scenario: Scenario, runs: int, folder: Path, pool: Executor) -> Iterator[Runs]:
    """Yield so many runs of a scenario in parts; those in the folder are not computed again."""
    ranges, paths = zip(*closed_loop.parts_of(scenario, runs, folder / "parts"), strict=True)
    yield from pool.map(partial(closed_loop.some_runs, scenario), ranges, paths)


def cases(options: argparse.Namespace) -> Iterator[mismatch.Case]:
    """Yield what `mismatch.cases` does, the first row of a map error, told, with its run-hours."""
    for case in mismatch.cases(options):
        if case.row is ROWS[0] and case.kind == "told":
            yield replace(case, runs=math.ceil(options.run_hours / HOURS))
        elif options.mismatch:
            yield case


def main() -> None:
    """Count and print."""
    parser = mismatch.parser_of(__doc__)
    parser.add_argument("--run-hours", type=float, default=360.0)
    parser.add_argument("--mismatch", action="store_true", help="the other rows, too")
    parser.add_argument("--figure", type=Path, help="PNG file for the first row's diagram")
    options = parser.parse_args()
    maps = coarse_map(options.data, options.out)
    together: dict[str, list[Count]] = {kind: [] for kind in reversed(get_args(mismatch.Kind))}
    seen: list[Scenario] = []
    lines = [closed_loop.head_of(HEAD)]
    print(lines[0], flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for case in cases(options):
            scenario, shown, counts = case.scenario(maps), [], []
            for part in parts_of(scenario, case.runs, options.out, pool):
                counts.append(Count.of(part, scenario.integrity))
                shown += [part] if len(shown) < SHOWN else []
            if options.figure and case.kind == "told" and case.row is ROWS[0]:
                write_atomic(options.figure, picture(shown, scenario.integrity))
            if scenario not in seen:  # "map 3 mGal wrong", told, is "nothing" once more
                together[case.kind] += counts
                seen.append(scenario)
            world = f", {case.base_name}" if len(options.map_errors) > 1 else ""
            kind = mismatch.label(case.row, case.kind)
            lines.append(line_of(case.row.name + world, kind, counts))
            print(lines[-1], flush=True)
    for kind, counts in together.items():
        if counts and options.mismatch:
            lines.append(line_of("all rows together", mismatch.LABELS[kind], counts))
            print(lines[-1])
    write_atomic(options.out / "integrity.md", "\n".join(lines) + "\n")
    closed_loop.write_between(options.page, MARKS, "\n".join(lines))


if __name__ == "__main__":
    main()
