"""What really is, where it differs from what the navigator and the matcher assume.

The section `truth` repeats keys of other sections; a number may be a multiple of what is assumed,
written `3x`, and a whole section may be one (`truth: {imu: 3x}`), if it says which of its keys are
errors."""

import math
import re
from collections.abc import Collection, Mapping

from isogal.scenario.section import (
    Document,
    Section,
    Value,
    merged,
    suggestion,
    validated,
    written,
)

SECTIONS = (
    "imu",
    "initial_error",
    "gravimeter",
    "magnetometer",
    "altimeter",
    "gradiometer",
    "height",
    "velocity",
    "gnss",
    "map",
    "gravity",
)
"""Sections of a scenario that `truth` may repeat."""
SHARED = (
    *("name", "kind", "quantity", "interval", "rate", "available", "online"),
    *("beams", "opening", "directions", "components"),
)
"""Keys of any section that say what is done rather than how well: the truth cannot differ in
them."""
_MULTIPLE = re.compile(r"\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)\s*x\s*")


def true_section(name: str, assumed: Section, changes: Value) -> Section:
    """Return a section as it really is.

    Parameters
    ----------
    name : str
        One of `SECTIONS`.
    assumed : Section
        What is assumed.
    changes : mapping, or str
        What `truth` says: keys with their values or multiples, or a multiple of all errors.

    Raises
    ------
    InputError
        One line: a section or key that `truth` cannot have, a multiple of what is no number, or
        values that are not allowed.
    """
    where = f"truth.{name}"
    if isinstance(changes, str) and _MULTIPLE.fullmatch(changes):
        changes = _multiples_of_errors(where, assumed, changes)
    if not isinstance(changes, Mapping):
        raise ValueError(
            f"{where}: must be keys of {name} with their true values, not {written(changes)}"
        )
    changes = _without_multiples(changes, assumed.resolved(), where)
    section = validated(type(assumed), merged(assumed.model_dump(), changes), f"{where}.")
    for key in SHARED:
        if (told := getattr(assumed, key, None)) != getattr(section, key, None):
            raise ValueError(
                f"truth.{name}.{key}: cannot differ from {name}.{key} ({told}), which says what"
                " the vehicle does"
            )
    return section


def truth_of(truth: Mapping[str, Value], sections: Collection[str]) -> Document:
    """Return what a section `truth` says of some sections alone, for a node that is not told the
    others; names that it cannot have stay, so that they are errors."""
    return {
        name: value for name, value in truth.items() if name in sections or name not in SECTIONS
    }


def check_names(truth: Mapping[str, Value]) -> None:
    """Raise ValueError where `truth` names a section that it cannot have."""
    known = [f"truth.{name}" for name in SECTIONS]
    for name in truth:
        if name not in SECTIONS:
            hint = suggestion(str(name), known) or f"; allowed: {', '.join(known)}"
            raise ValueError(f"unknown key 'truth.{name}'{hint}")


def _multiples_of_errors(where: str, assumed: Section, multiple: str) -> Document:
    """Return keys that multiply all errors of a section, but those that are zero or not known."""
    changes: Document = {}
    for key in assumed.errors:
        *parents, leaf = key.split(".")
        target, value = changes, assumed.resolved()
        for parent in parents:
            target, value = target.setdefault(parent, {}), value[parent]
        if _multiple(1.0, value[leaf]) is not None:
            target[leaf] = multiple
    if not changes:
        raise ValueError(f"{where}: {multiple} of the whole section says nothing; name its keys")
    return changes


def _without_multiples(changes: Mapping[str, Value], assumed: Document, where: str) -> Document:
    """Return changes with numbers in place of multiples of what is assumed."""
    result = dict(changes)
    for key, value in changes.items():
        known, place = assumed.get(key), f"{where}.{key}"
        if isinstance(value, Mapping) and isinstance(known, Mapping):
            result[key] = _without_multiples(value, dict(known), place)
        elif key in assumed and isinstance(value, str) and (match := _MULTIPLE.fullmatch(value)):
            result[key] = _multiple(float(match[1]), known)
            if result[key] is None:
                raise ValueError(f"{place}: {value.strip()} of {written(known)} says nothing")
    return result


def _multiple(factor: float, assumed: Value) -> Value:
    """Return a number, or each of several, times a factor; None where all are zero, or something
    else is among them."""
    if isinstance(assumed, tuple | list):
        each = [_multiple(factor, one) if one != 0.0 else 0.0 for one in assumed]
        return each if any(each) and None not in each else None
    if not isinstance(assumed, int | float) or isinstance(assumed, bool):
        return None
    return factor * assumed if assumed != 0.0 and math.isfinite(assumed) else None
