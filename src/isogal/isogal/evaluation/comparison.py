"""Runs or studies side by side: `isogal compare`."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.evaluation.figures import style
from isogal.evaluation.figures.ensemble import Curve, rms_figure
from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report

FILES = ("results.json", "summary.json")
"""What `isogal montecarlo` and `isogal run` write."""
_LINES = (
    style.Line(style.BLUE, "-", 1.5),
    style.Line(style.VERMILION, (0, (5, 2)), 1.5),
    style.Line(style.GREEN, (0, (5, 1.5, 1, 1.5)), 1.5),
    style.Line(style.PURPLE, (0, (1, 1)), 1.7),
    style.Line(style.ORANGE, "-", 1.0),
    style.Line(style.SKY, (0, (5, 2)), 1.0),
)
_MERITS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("runs", ("runs",)),
    ("mean position error (m)", ("position_error", "mean")),
    ("RMS position error (m)", ("position_error", "rms")),
    ("RMS after 1 h (m)", ("position_error", "rms_after_1h")),
    ("bound, RMS after 1 h (m)", ("bound", "rms_after_1h")),
    ("unaided INS, RMS (m)", ("unaided", "rms")),
    ("NEES per axis", ("nees_per_axis", "mean")),
    ("NEES per axis, all scans", ("nees_all_scans", "mean")),
    ("protection level, median (m)", ("integrity", "level", "median")),
    ("diverged", ("diverged",)),
    ("fixes published", ("fixes", "published")),
    ("fixes declined", ("fixes", "declined")),
    ("of these the matcher failed", ("fixes", "failed")),
    ("of these the navigator rejected", ("fixes", "rejected")),
    ("computing time of a fix (ms)", ("time", "fix_ms_median")),
)


@dataclass(frozen=True, slots=True)
class Comparison:
    """What differs between runs, and their figures of merit; a value for each run."""

    names: list[str]
    settings: dict[str, list[Any]]
    """Keys of the scenarios that are not the same in all."""
    merits: dict[str, list[float | None]]

    def rows(self) -> list[tuple[str, ...]]:
        """Return rows of text: settings, then figures of merit."""
        settings = [(key, *map(_text, values)) for key, values in self.settings.items()]
        merits = [(name, *map(_number, values)) for name, values in self.merits.items()]
        return settings + merits

    def document(self) -> dict[str, Any]:
        """Return it as JSON can say it."""
        return {"runs": self.names, "settings": self.settings, "merits": self.merits}


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object; raises InputError where it is none."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{path}: not JSON: {error}") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: must be a JSON object")
    return document


def read_results(sources: Sequence[Path]) -> dict[str, dict[str, Any]]:
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
    results = {name: read_json(file) for name, file in zip(names, files, strict=True)}
    for file, result in zip(files, results.values(), strict=True):
        if not {"scenario", "position_error", "runs"} <= result.keys():
            raise InputError(f"{file}: not the results of a run or a study")
    return results


def comparison(results: dict[str, dict[str, Any]]) -> Comparison:
    """Compare results by name."""
    every = [dict(_flat(result["scenario"])) for result in results.values()]
    keys = dict.fromkeys(key for settings in every for key in settings)
    settings = {key: [one.get(key) for one in every] for key in keys}
    return Comparison(
        list(results),
        {key: values for key, values in settings.items() if any(v != values[0] for v in values)},
        {name: [_value(result, path) for result in results.values()] for name, path in _MERITS},
    )


def write_comparison(out_dir: Path, results: dict[str, dict[str, Any]], found: Comparison) -> Path:
    """Write report.html and its figure into a folder; return the page's path."""
    curves = []
    for index, (name, result) in enumerate(results.items()):
        over_time = result.get("rms_over_time") or {}
        if not over_time.get("time"):
            continue
        time = np.array(over_time["time"], dtype=np.float64)
        if index == 0:
            unaided = np.array(over_time["unaided"], dtype=np.float64)
            curves.append(Curve(f"unaided INS of {name}", time, unaided, _UNAIDED))
        aided = np.array(over_time["aided"], dtype=np.float64)
        curves.append(Curve(name, time, aided, _LINES[index % len(_LINES)]))
    pictures = []
    if curves:
        caption = "RMS position error of the aided navigators over time."
        pictures.append(Illustration("rms_over_time", rms_figure(curves), caption))
    rows = found.rows()
    changed, merits = rows[: len(found.settings)], rows[len(found.settings) :]
    tables = [Table("Figures of merit.", ("", *found.names), merits)]
    if changed:
        tables.append(Table("What differs in the scenarios.", ("key", *found.names), changed))
    return write_report(
        out_dir, f"{len(results)} runs side by side", [Section("Errors", (), pictures)], tables
    )


_UNAIDED = style.Line("0.5", (0, (1, 1.2)))


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


def _flat(value: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and their values."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(item, f"{prefix}.{key}" if prefix else str(key))
    else:
        yield prefix, value


def _value(result: Any, path: Sequence[str]) -> float | None:
    for key in path:
        result = result.get(key) if isinstance(result, dict) else None
    return result if isinstance(result, int | float) else None


def _text(value: Any) -> str:
    return "–" if value is None else str(value)


def _number(value: float | None) -> str:
    return str(value) if isinstance(value, int) else number(value)
