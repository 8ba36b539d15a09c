"""Runs or studies side by side: `isogal compare`."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.evaluation.figures import style
from isogal.evaluation.figures.errors import Curve, rms_figure
from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.evaluation.results import read_object
from isogal.files import Json

FILES = ("results.json", "summary.json")
"""What `isogal montecarlo` and `isogal run` write."""
_LINES = (
    *style.SERIES,
    style.Line(style.PURPLE, (0, (1, 1)), 1.7),
    style.Line(style.ORANGE, "-", 1.0),
    style.Line(style.SKY, (0, (5, 2)), 1.0),
)
_UNAIDED = style.Line("0.5", (0, (1, 1.2)))
_MERITS = {
    "runs": "runs",
    "mean position error (m)": "position_error.mean",
    "RMS position error (m)": "position_error.rms",
    "RMS after 1 h (m)": "position_error.rms_after_1h",
    "bound, RMS after 1 h (m)": "bound.rms_after_1h",
    "unaided INS, RMS (m)": "unaided.rms",
    "NEES per axis": "nees_per_axis.mean",
    "NEES per axis, all scans": "nees_all_scans.mean",
    "protection level, median (m)": "integrity.level.median",
    "diverged": "diverged",
    "fixes published": "fixes.published",
    "fixes declined": "fixes.declined",
    "of these the matcher failed": "fixes.failed",
    "of these the navigator rejected": "fixes.rejected",
    "computing time of a fix (ms)": "time.fix_ms_median",
}
"""Dotted keys of the results."""

Document = Mapping[str, Json]
Row = tuple[str, ...]


def read_results(sources: Sequence[Path]) -> dict[str, Document]:
    """Read the results of runs or studies, from their folders or files.

    Returns
    -------
    dict
        By name: the folder's, or as much of the path as tells them apart.

    Raises
    ------
    InputError
        Fewer than two, one given twice, or one without results.
    """
    files = [_file_of(source) for source in sources]
    if len(set(files)) < 2 or len(set(files)) < len(files):
        raise InputError("compare needs two or more different runs or studies")
    names = _names([file.parent if file.name in FILES else file for file in files])
    results = {name: read_object(file) for name, file in zip(names, files, strict=True)}
    for file, result in zip(files, results.values(), strict=True):
        if not {"scenario", "position_error", "runs"} <= result.keys():
            raise InputError(f"{file}: not the results of a run or a study")
    return results


def comparison(results: dict[str, Document]) -> dict[str, dict[str, list[Json]]]:
    """Return what differs between results by name: `settings`, the keys of the scenarios that are
    not the same in all, and `merits`, figures of merit; a value for each."""
    every = [dict(_flat(result["scenario"])) for result in results.values()]
    keys = dict.fromkeys(key for settings in every for key in settings)
    settings = {key: [one.get(key) for one in every] for key in keys}
    flat = [dict(_flat(result)) for result in results.values()]
    return {
        "settings": {key: x for key, x in settings.items() if any(v != x[0] for v in x)},
        "merits": {name: [one.get(key) for one in flat] for name, key in _MERITS.items()},
    }


def rows_of(found: dict[str, dict[str, list[Json]]]) -> tuple[list[Row], list[Row]]:
    """Return what `comparison` returns as rows of text: settings, and figures of merit."""
    settings = [
        (key, *("–" if x is None else str(x) for x in values))
        for key, values in found["settings"].items()
    ]
    merits = [
        (name, *(number(x) if isinstance(x, float | None) else str(x) for x in values))
        for name, values in found["merits"].items()
    ]
    return settings, merits


def write_comparison(out_dir: Path, results: dict[str, Document]) -> Path:
    """Write report.html and its figure into a folder; return the page's path."""
    curves = []
    for index, (name, result) in enumerate(results.items()):
        flat = dict(_flat(result))
        time, aided, unaided = (
            np.array(flat.get(f"rms_over_time.{key}") or [], dtype=np.float64)
            for key in ("time", "aided", "unaided")
        )
        if not time.size:
            continue
        if index == 0:
            curves.append(Curve(f"unaided INS of {name}", time, unaided, _UNAIDED))
        curves.append(Curve(name, time, aided, _LINES[index % len(_LINES)]))
    pictures = []
    if curves:
        caption = "RMS position error of the aided navigators over time."
        pictures.append(Illustration("rms_over_time", rms_figure(curves), caption))
    found = comparison(results)
    changed, merits = rows_of(found)
    tables = [Table("Figures of merit.", ("", *results), merits)]
    if changed:
        tables.append(Table("What differs in the scenarios.", ("key", *results), changed))
    title = f"{len(results)} runs side by side"
    return write_report(out_dir, title, [Section("Errors", (), pictures)], tables)


def _file_of(source: Path) -> Path:
    if source.is_file():
        return source
    for name in FILES:
        if (source / name).is_file():
            return source / name
    raise InputError(f"{source}: no {' or '.join(FILES)} there")


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the shortest ends of paths that differ."""
    parts = [path.resolve().parts for path in paths]
    for count in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-count:]) for part in parts]
        if len(set(names)) == len(names):
            break
    return names


def _flat(value: Json, prefix: str = "") -> Iterator[tuple[str, Json]]:
    """Yield dotted keys and their values."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{prefix}.{key}" if prefix else str(key))
    else:
        yield prefix, value
