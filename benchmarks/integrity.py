"""How often the error exceeds the protection level at 0.1, 0.01 and 0.001 per hour.

    python benchmarks/integrity.py --data DIR [--out DIR] [--run-hours 20000] [--mismatch]
        [--rows TEXT ...] [--runs 24] [--told-runs 100] [--map-errors 3e-5 0] [--present]
        [--workers 2] [--page docs/evidence/protection-level.md]
        [--figure docs/figures/stanford.png]

Run-hours are of the row "nothing" of `mismatch.py` (a map 3 mGal wrong, told), in runs of 3.6 h;
`--mismatch` adds its other rows, told and untold. Parts of ten runs are taken from its folder
`--out` where they are there, else computed; what integrity needs of them is kept in
`--out`/integrity and not computed again. `--present` computes nothing: it counts what is there.
After a change of the library, begin with an empty folder."""

import argparse
import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
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
from isogal.evaluation.figures.stanford import stanford_figure
from isogal.evaluation.integrity import RISKS, Rate, Solution, correlation_time, exceedances
from isogal.evaluation.records import Runs
from isogal.files import atomic_path, write_atomic
from isogal.montecarlo.engine import simulate
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


@dataclass
class Count:
    """Figures of a row, part by part."""

    settings: Integrity = field(default_factory=Integrity)
    hours: float = 0.0
    events: dict[float, int] = field(default_factory=lambda: dict.fromkeys(RISKS, 0))
    levels: list[Array] = field(default_factory=list)
    """m, at the settings' risk."""
    sigmas: list[Array] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    """Correlation time of each part, s."""
    squares: list[Array] = field(default_factory=list)
    """e' P^-1 e of each part, of some states."""
    shown: list[Solution] = field(default_factory=list)
    """The first parts, for the figure."""

    def add(self, part: Solution) -> None:
        """Count a part."""
        self.hours += part.hours
        for risk in RISKS:
            self.events[risk] += exceedances(part, self.settings, risk).events
        level = part.level(self.settings)
        self.levels.append(level.ravel().astype(np.float32))
        self.sigmas.append(part.sigmas(level).ravel().astype(np.float32))
        self.times.append(correlation_time(part))
        some = slice(None, None, THINNED)
        nees = nees_per_axis(part.error[:, some], part.covariance[:, some])
        self.squares.append(2.0 * nees[np.isfinite(nees)])
        if len(self.shown) < SHOWN:
            self.shown.append(part)

    def merge(self, other: "Count") -> None:
        """Count a row."""
        self.hours += other.hours
        for risk in RISKS:
            self.events[risk] += other.events[risk]
        self.levels += other.levels
        self.sigmas += other.sigmas
        self.times += other.times
        self.squares += other.squares

    def line(self, name: str, kind: str) -> str:
        """Return a line of the table."""
        level, sigmas = (np.median(np.concatenate(it)) for it in (self.levels, self.sigmas))
        rates = (cell(Rate(self.events[risk], self.hours), risk) for risk in RISKS)
        factor, freedom = tails(np.concatenate(self.squares))
        words = f"{freedom:.0f}" if freedom < 1000.0 else "Gaussian"
        cells = (
            name, kind, f"{self.hours:.0f}", f"{np.nanmedian(self.times):.0f}",
            f"{factor:.2f}, {words}", f"{level:.0f}", f"{sigmas:.2f}", *rates,
        )  # fmt: skip
        return closed_loop.line_of(cells)


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


def picture(count: Count) -> bytes:
    """Return the Stanford diagram of a row's first parts as PNG."""
    error, covariance = (
        np.concatenate([getattr(part, name) for part in count.shown])
        for name in ("error", "covariance")
    )
    solution = Solution(count.shown[0].time, error, covariance)
    return style.png(stanford_figure(solution, count.settings))


def cell(rate: Rate, allowed: float) -> str:
    """Return count, rate and interval; in bold where events come more often than allowed."""
    low, high = rate.interval
    text = f"{rate.events}: {rate.per_hour:.2g} ({low:.2g} to {high:.2g})"
    return f"**{text}**" if rate.verdict(allowed) == "more often" else text


def some(scenario: Scenario, runs: range, full: Path, path: Path, present: bool) -> Path | None:
    """Make the file of a part that integrity needs, if it is not there, or older than the part;
    return it, or None where it would have to be computed and is not to be."""
    if path.exists() and not (full.exists() and full.stat().st_mtime > path.stat().st_mtime):
        return path
    if not full.exists() and present:
        return None
    record = Runs.load(full) if full.exists() else simulate(scenario, runs)
    covariance = record.covariance[..., [0, 0, 1], [0, 1, 1]]
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream,
            time=record.time,
            error=record.error.astype(np.float32),
            covariance=covariance.astype(np.float32),
        )
    return path


def load(path: Path) -> Solution:
    """Read the file of a part."""
    with np.load(path) as stored:
        time, error, three = (stored[name] for name in ("time", "error", "covariance"))
    covariance = three.astype(np.float64)[..., [0, 1, 1, 2]].reshape(*three.shape[:-1], 2, 2)
    return Solution(time, error.astype(np.float64), covariance)


def counted(
    scenario: Scenario, runs: int, options: argparse.Namespace, pool: ProcessPoolExecutor
) -> Count:
    """Return the figures of so many runs of a scenario, or of those that are there."""
    count = Count(scenario.integrity)
    parts = list(closed_loop.parts_of(scenario, runs, options.out / "parts"))
    jobs = [
        pool.submit(
            some, scenario, which, full, options.out / "integrity" / full.name, options.present
        )
        for which, full in parts
    ]
    for job in jobs:
        path = job.result()
        if path is not None:
            count.add(load(path))
    return count


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
    parser.add_argument("--present", action="store_true", help="compute nothing")
    parser.add_argument("--figure", type=Path, help="PNG file for the first row's diagram")
    options = parser.parse_args()
    maps = coarse_map(options.data, options.out)
    together = {kind: Count() for kind in reversed(get_args(mismatch.Kind))}
    seen: list[Scenario] = []
    lines = [closed_loop.head_of(HEAD)]
    print(lines[0], flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for case in cases(options):
            scenario = case.scenario(maps)
            count = counted(scenario, case.runs, options, pool)
            if count.hours == 0.0:
                continue
            if options.figure and case.kind == "told" and case.row is ROWS[0]:
                write_atomic(options.figure, picture(count))
            if scenario not in seen:  # "map 3 mGal wrong", told, is "nothing" once more
                together[case.kind].merge(count)
                seen.append(scenario)
            world = f", {case.base_name}" if len(options.map_errors) > 1 else ""
            lines.append(count.line(case.row.name + world, mismatch.label(case.row, case.kind)))
            print(lines[-1], flush=True)
    for kind, count in together.items():
        if count.hours > 0.0 and options.mismatch:
            lines.append(count.line("all rows together", mismatch.LABELS[kind]))
            print(lines[-1])
    write_atomic(options.out / "integrity.md", "\n".join(lines) + "\n")
    closed_loop.write_between(options.page, MARKS, "\n".join(lines))


if __name__ == "__main__":
    main()
