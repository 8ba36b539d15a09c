"""JSON as `results.json` and `summary.json` have it: None = not known."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.files import Json, reading, write_atomic

Number = float | None
Summary = dict[str, Any]
"""What `isogal.evaluation.summary.summarise` returns, and its sections."""


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
