"""What `results.json` and `summary.json` hold, and JSON as these files have it: figures of merit
of a set of runs. Lengths in m, times in s; None = not known."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import numpy as np

from isogal.errors import InputError
from isogal.files import Json, reading, write_atomic

Number = float | None


class Nees(TypedDict):
    """NEES per axis, with the chi-square interval of a consistent navigator's mean, for as many
    independent values as these are worth (docs/mathematics.md, section 11.3)."""

    mean: Number
    interval: list[Number]


class Judgement(TypedDict):
    """Share of the runs that are good or let their user down, and indices of the latter, by kind
    (`isogal.evaluation.judgement`)."""

    share: dict[str, float]
    runs: dict[str, list[int]]


class Events(TypedDict):
    """How often something happened: count, rate per hour and its Poisson interval of 95 %."""

    events: int
    rate: float
    interval: list[float]


class Exceedance(Events):
    """Of the protection level at a risk per hour; verdict: rarer, consistent or more often."""

    risk: float
    verdict: str


class Alerts(TypedDict):
    """Share of states whose level is within the alert limit, and how often the error is beyond it
    while the level is within."""

    limit: float
    available: float
    hazardous: Events


class IntegritySummary(TypedDict):
    """What was promised of the errors, at a risk per hour."""

    risk: float
    run_hours: float
    correlation_time: dict[str, Number]
    """Of the error: assumed, and measured in these runs."""
    level: dict[str, Number]
    """Median over states and runs, and that in 1-sigmas along the major axis."""
    exceedances: list[Exceedance]
    alert_limit: Alerts | None


class SmoothedSummary(TypedDict):
    """What all data of a voyage say of each of its states (`montecarlo --smooth`)."""

    position_error: dict[str, Number]
    nees_per_axis: Nees
    """At every recorded state."""
    bound: dict[str, Number]
    """Of one that knows all readings."""
    ratio: Number
    """RMS error over RMS bound, whole run."""
    of_causal: Number
    """RMS error over that of the navigator at the time."""
    rms_over_time: dict[str, list[Number]]


class Recording(TypedDict):
    """What is missing in the recording that the figures are of."""

    gaps: list[list[float]]
    """From when to when nothing was recorded, s."""


class Summary(TypedDict):
    """The whole document."""

    scenario: dict[str, Json]
    matcher: str
    runs: int
    diverged: int
    position_error: dict[str, Number]
    """Horizontal: mean and RMS over time and runs, both also after the first hour."""
    unaided: dict[str, Number]
    bound: dict[str, Number]
    nees_per_axis: Nees
    """Of the navigator right after the published fixes."""
    nees_all_scans: Nees
    """At every recorded state but the start."""
    judgement: Judgement
    integrity: IntegritySummary
    fixes: dict[str, int]
    """Batches that gave a fix, and that did not; of these, on which the matcher has failed, and
    whose fix the navigator rejected."""
    time: dict[str, Number]
    """That all took, and a fix."""
    rms_over_time: dict[str, list[Number]]
    smoothed: NotRequired[SmoothedSummary]
    """Where the runs were smoothed."""
    recording: NotRequired[Recording]
    """Where there is one: of a run of the nodes."""


def finite(value: float) -> Number:
    """Return a number as JSON can say it: None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def plain(value: Any) -> Json:
    """Convert arrays, NumPy scalars and tuples to the types of JSON; a number that is not finite
    becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return finite(value) if isinstance(value, float) else value


def canonical_json(value: object) -> str:
    """Format a document so that equal content gives equal bytes: order of keys as given, two
    spaces, lists of numbers in a line."""
    return _format(plain(value), "") + "\n"


def write_json(path: str | Path, value: object) -> None:
    """Write `canonical_json` of the value; the file appears whole or not at all."""
    write_atomic(path, canonical_json(value))


def _format(value: Json, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, Mapping) and value:
        items = (
            f"{inner}{json.dumps(key, ensure_ascii=False)}: {_format(item, inner)}"
            for key, item in value.items()
        )
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return "[\n" + ",\n".join(inner + _format(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_json(path: Path) -> Json:
    """Read a JSON file; raises InputError where it is none."""
    with reading(path):
        text = path.read_text(encoding="utf-8")
    try:
        document: Json = json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None
    return document


def read_object(path: Path) -> Mapping[str, Json]:
    """Read a JSON object; raises InputError where it is none."""
    document = read_json(path)
    if not isinstance(document, Mapping):
        raise InputError(f"{path}: must be a JSON object")
    return document
