"""What the studies of this folder share: their options, runs that are kept, figures of merit,
tables and pages.

A script imports this module before NumPy, as `import closed_loop` stands first among the modules
from elsewhere: it asks for one thread."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.evaluation.results import write_json
from isogal.evaluation.summary import summarise
from isogal.fields.scenario_map import maps_for_scenario
from isogal.files import write_atomic
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory

CHUNK = 10
"""Runs to a job and to a file."""
END = "<!-- end of the table -->"
Figures = dict[str, float]
Bound = Callable[[Scenario, Runs], Array]
"""Returns (K,) m, the RMS bound at the times of a record."""


def folder(name: str) -> Path:
    """Return a folder that is there: the type of an option."""
    if not Path(name).is_dir():
        raise argparse.ArgumentTypeError(f"{name}: no such folder")
    return Path(name)


def _one_line(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print what is wrong with an input without a traceback."""
    if isinstance(error, InputError | FileNotFoundError):
        print(f"{Path(sys.argv[0]).name}: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


_OPTIONS = {
    "--data": {"type": folder, "required": True, "help": "folder of the data"},
    "--out": {"type": Path, "required": True, "help": "folder of the results"},
    "--page": {"type": Path, "help": "page whose table is replaced"},
    "--figure": {"type": Path, "help": "PNG file to write"},
    "--json": {"action": "store_true", "help": "print the results as JSON"},
    "--map": {"help": "map file; default: the synthetic map"},
    "--runs": {"type": int, "help": "runs of each case"},
    "--workers": {"type": int, "default": 2, "help": "processes"},
    "--duration": {"type": float, "help": "s to simulate"},
    "--case": {"action": "append", "metavar": "TEXT", "help": "cases that begin with this"},
    "--rows": {"nargs": "+", "metavar": "TEXT", "help": "rows with TEXT in their name"},
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "KEY=VALUE",
        "help": "of the scenario",
    },
}


def parser(
    doc: str | None, *names: str, **defaults: str | float | Path
) -> argparse.ArgumentParser:
    """Return a parser with those of the common options that are named, or have a default here; its
    description is the script's docstring. From then on what is wrong with an input is one line."""
    sys.excepthook = _one_line
    made = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name in (*names, *defaults):
        default = {"default": defaults[name], "required": False} if name in defaults else {}
        flags = _OPTIONS[f"--{name}"] | default
        if "action" in flags:
            flags.pop("required", None)
        made.add_argument(f"--{name}", **flags)
    return made


def matching(name: str, beginnings: Sequence[str] | None) -> bool:
    """Return whether a name begins with one of the texts, or none is given."""
    return not beginnings or name.startswith(tuple(beginnings))


def containing(name: str, texts: Sequence[str] | None) -> bool:
    """Return whether one of the texts is in a name, or none is given."""
    return not texts or any(text in name for text in texts)


def parts_of(
    scenario: Scenario, count: int, folder: Path, chunk: int = CHUNK, lag: float = 0.0
) -> Iterator[tuple[range, Path]]:
    """Yield the runs of a scenario in parts, each with the file that keeps it; `lag` as in
    `isogal.montecarlo.engine.simulate`."""
    text = json.dumps(scenario.model_dump(mode="json", exclude_defaults=True), sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:16]
    for first in range(0, count, chunk):
        last = min(first + chunk, count)
        smoothed = f"-smoothed-{lag:g}" if lag else ""
        yield range(first, last), folder / f"{name}{smoothed}-{first}-{last}.npz"


def of_source(text: str, folders: Iterable[Path]) -> str:
    """Return what stands for a text and the source in some folders: of what is kept by them."""
    found = hashlib.sha256(text.encode())
    for folder in folders:
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.yaml")]):
            found.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return found.hexdigest()[:16]


def some_runs(scenario: Scenario, runs: range, path: Path, lag: float = 0.0) -> Runs:
    """Return some runs, from the file where it is."""
    if path.exists():
        return Runs.load(path)
    result = simulate(scenario, runs, lag=lag)
    result.save(path)
    return result


def kept_runs(
    scenario: Scenario,
    count: int,
    folder: Path,
    pool: Executor,
    chunk: int = CHUNK,
    lag: float = 0.0,
) -> Runs:
    """Return runs of a scenario; those that are in the folder are not computed again."""
    ranges, paths = zip(*parts_of(scenario, count, folder, chunk, lag), strict=True)
    compute = partial(some_runs, scenario, lag=lag)
    return Runs.concatenate(list(pool.map(compute, ranges, paths)))


def new_runs(scenario: Scenario, runs: range, pool: Executor, chunk: int = CHUNK) -> Runs:
    """Simulate runs of a scenario."""
    parts = [runs[k : k + chunk] for k in range(0, len(runs), chunk)]
    return Runs.concatenate(list(pool.map(partial(simulate, scenario), parts)))


def bound_of(scenario: Scenario, record: Runs) -> Array:
    """Return (K,) m, the RMS bound at the times of a record."""
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    bound = posterior_cramer_rao(scenario.true, trajectory, maps)
    return bound.rms_at(record.time)


def rms(values: Array) -> float:
    """Return the root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


def jackknife(statistic: Callable[..., float], *samples: Array) -> tuple[float, float]:
    """Return a statistic of samples of one length, and its standard error with them as pairs."""
    value, count = statistic(*samples), len(samples[0])
    if count < 2:
        return value, float("nan")
    without = [statistic(*(np.delete(one, i) for one in samples)) for i in range(count)]
    return value, float(np.sqrt((count - 1) * np.var(without)))


def figures_of(
    scenario: Scenario, record: Runs, bound: Array, settled: float = SETTLED_AFTER
) -> Figures:
    """Return the figures of merit of runs.

    Parameters
    ----------
    scenario : Scenario
    record : Runs
        R runs at K instants.
    bound : (K,) array
        m, RMS; NaN = not known.
    settled : float
        s, after which errors count.

    Returns
    -------
    dict
        RMS error, bound and error of the unaided INS (m) after `settled`, `ratio` of the first two
        with its standard error; NEES per axis after fixes, of all states but the first, and of
        states after `settled`; runs that have diverged, batches without a fix, the share of those
        with one, and the time of a fix, ms; of each judgement the share of the runs in per cent.
    """
    summary = summarise(record, scenario, bound)
    late = record.elapsed > settled
    squared = (record.horizontal_error[:, late] ** 2).mean(axis=1)
    error, limit = float(np.sqrt(squared.mean())), rms(bound[late])
    seconds = record.fix_seconds[np.isfinite(record.fix_seconds)]
    shares = summary["judgement"]["share"]
    found = {
        "runs": len(record),
        "rms": error,
        "bound": limit,
        "unaided": rms(record.unaided_horizontal_error[:, late]),
        "ratio": error / limit,
        "ratio_error": float(squared.std() / np.sqrt(len(record)) / (2.0 * error) / limit),
        "nees": summary["nees_per_axis"]["mean"],
        "nees_all_scans": summary["nees_all_scans"]["mean"],
        "nees_settled": float(
            np.mean(nees_per_axis(record.error[:, late], record.covariance[:, late]))
        ),
        "diverged": summary["diverged"],
        "declined": summary["fixes"]["declined"],
        "fixes": summary["fixes"]["published"] / max(1, record.published.size),
        "fix_ms": 1e3 * float(np.median(seconds)) if seconds.size else None,
        **{f"{name}_percent": 100.0 * share for name, share in shares.items()},
    }
    return {name: np.nan if value is None else value for name, value in found.items()}


def cells_of(figures: Figures, columns: Mapping[str, str]) -> list[str]:
    """Return a row's cells; each column has a pattern such as ``{rms:.1f}``. NaN is a dash, and so
    are two with ± or "to" between them."""
    cells = [pattern.format(**figures) for pattern in columns.values()]
    return [re.sub("nan( (±|to) nan)?", "–", cell) for cell in cells]


def line_of(cells: Iterable[str]) -> str:
    """Return a line of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def head_of(names: Sequence[str]) -> str:
    """Return the first two lines of a Markdown table."""
    return f"{line_of(names)}\n|{'---|' * len(names)}"


def markdown(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    return "\n".join([head_of(head), *map(line_of, rows)])


def study(
    head: Sequence[str],
    cases: Mapping[tuple[str, ...], Scenario],
    columns: Mapping[str, str],
    options: argparse.Namespace,
    *,
    bound: Bound = bound_of,
    settled: float = SETTLED_AFTER,
) -> str:
    """Run cases, print their table line by line, and keep the figures in `--out`.

    Parameters
    ----------
    head : sequence of str
        Of the columns that name a case.
    cases : mapping of tuples to Scenario
        By a case's first cells.
    columns : mapping of str to str
        Patterns of the other cells, by the columns' heads.
    options : Namespace
        With `runs`, `workers` and, where they are wanted, `first` (the first run's number) and
        `out`.
    bound : callable
    settled : float
        s, after which errors count.

    Returns
    -------
    str
        The table, in Markdown.
    """
    first, results = getattr(options, "first", 0), {}
    lines = [head_of([*head, *columns])]
    print(lines[0], flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for names, scenario in cases.items():
            record = new_runs(scenario, range(first, first + options.runs), pool)
            found = figures_of(scenario, record, bound(scenario, record), settled)
            results[", ".join(names)] = found
            lines.append(line_of([*names, *cells_of(found, columns)]))
            print(lines[-1], flush=True)
            if getattr(options, "out", None):
                write_json(options.out / "results.json", results)
    return "\n".join(lines)


def marks_of(script: str, end: str = END) -> tuple[str, str]:
    """Return the marks of a script's table in a page."""
    return f"<!-- table of benchmarks/{Path(script).name} -->", end


def revision() -> str:
    """Return the revision of the code that measures, with a plus sign where files of its packages
    differ from it; empty outside of a repository."""
    git = ["git", "-C", str(Path(__file__).parent.parent)]
    head = subprocess.run(
        [*git, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=False
    )
    changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", "src"], check=False)
    return head.stdout.strip() + ("+" if head.returncode == 0 and changed.returncode else "")


def write_between(
    page: Path | None, marks: tuple[str, str], text: str, *, seed: int | None = None
) -> None:
    """Put a text between two marks of a page, if there is a page; at its head today's date, the
    revision of the code, and the seed of the scenarios, where it is given.

    Raises
    ------
    SystemExit
        The page has not both marks.
    """
    if page is None:
        return
    before = page.read_text(encoding="utf-8")
    pattern = re.escape(marks[0]) + ".*?" + re.escape(marks[1])
    head = f"Of {datetime.now(UTC):%Y-%m-%d}"
    if code := revision():
        head += f", revision `{code}`"
    if seed is not None:
        head += f", seed {seed}"
    new = f"{marks[0]}\n{head}.\n\n{text}\n{marks[1]}"
    after, found = re.subn(pattern, lambda _: new, before, flags=re.DOTALL)
    if not found:
        raise SystemExit(f"{page}: has no '{marks[0]}' followed by '{marks[1]}'")
    write_atomic(page, after)
