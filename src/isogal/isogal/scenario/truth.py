"""What really is, where it differs from what the navigator and the matcher are told.

The section `truth` repeats keys of other sections; a number may be a multiple of what is told,
written `3x`, and a whole section may be one (`truth: {imu: 3x}`), if it says which of its keys are
errors. The scenario with these keys put in place is `Scenario.world`: simulations and the bound
take their settings from there, filter, matcher and reductions from the scenario itself."""

import difflib
import math
import re
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from isogal.scenario.section import Section

if TYPE_CHECKING:
    from isogal.scenario.model import Scenario

SECTIONS = (
    "imu",
    "initial_error",
    "gravimeter",
    "magnetometer",
    "altimeter",
    "gradiometer",
    "height",
    "velocity",
    "map",
    "gravity",
)
"""Sections of a scenario that `truth` may repeat."""
SHARED = (
    "imu.rate",
    "gravimeter.quantity",
    "gravimeter.interval",
    "magnetometer.online",
    "altimeter.beams",
    "altimeter.opening",
    "altimeter.directions",
    "gradiometer.components",
    "height.interval",
    "velocity.interval",
    "velocity.kind",
)
"""Keys of them that say what is done rather than how well: the truth cannot differ in them."""
_MULTIPLE = re.compile(r"\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)\s*x\s*")


def true_scenario(scenario: "Scenario") -> "Scenario":
    """Return a scenario with the keys of its section `truth` in place, and that section empty.

    Raises
    ------
    ValueError
        One line: a section or key that `truth` cannot have, a multiple of what is no number, or
        values that are not allowed.
    """
    changed = {
        name: _true_section(name, getattr(scenario, name), scenario.truth[name])
        for name in _known(scenario.truth)
    }
    values = {name: getattr(scenario, name) for name in type(scenario).model_fields}
    try:
        return type(scenario).model_validate(values | changed | {"truth": {}})
    except ValidationError as error:
        raise ValueError(f"truth: {_text(error, type(scenario), '')}") from None


def truth_of(truth: Mapping[str, Any], sections: Collection[str]) -> dict[str, Any]:
    """Return what a section `truth` says of some sections alone, for a node that is not told the
    others; names that it cannot have stay, so that they are errors."""
    return {
        name: value for name, value in truth.items() if name in sections or name not in SECTIONS
    }


def _known(truth: Mapping[str, Any]) -> Iterator[str]:
    for name in truth:
        if name not in SECTIONS:
            close = difflib.get_close_matches(str(name), SECTIONS, n=1, cutoff=0.6)
            hint = (
                f", did you mean 'truth.{close[0]}'?"
                if close
                else f"; allowed: {', '.join(f'truth.{known}' for known in SECTIONS)}"
            )
            raise ValueError(f"unknown key 'truth.{name}'{hint}")
        yield name


def _true_section(name: str, told: Section, changes: Any) -> Section:
    where, document, numbers = f"truth.{name}", told.model_dump(), told.resolved()
    if isinstance(changes, str) and _MULTIPLE.fullmatch(changes):
        changes = _multiples_of_errors(where, told, changes)
    if not isinstance(changes, Mapping):
        raise ValueError(
            f"{where}: must be keys of {name} with their true values, not {changes!r}"
        )
    _merge(document, numbers, changes, where)
    try:
        section = type(told).model_validate(document)
    except ValidationError as error:
        raise ValueError(_text(error, type(told), f"{where}.")) from None
    for key in SHARED:
        parent, _, leaf = key.partition(".")
        if parent == name and getattr(section, leaf) != getattr(told, leaf):
            raise ValueError(
                f"truth.{key}: cannot differ from {key} ({getattr(told, leaf)}), which says what"
                " the vehicle does"
            )
    return section


def _multiples_of_errors(where: str, told: Section, multiple: str) -> dict[str, Any]:
    """Return keys that multiply all errors of a section, but those that are zero or not known."""
    changes: dict[str, Any] = {}
    for key in told.errors:
        *parents, leaf = key.split(".")
        target, value = changes, told.resolved()
        for parent in parents:
            target, value = target.setdefault(parent, {}), value[parent]
        if _has_numbers(value[leaf]):
            target[leaf] = multiple
    if not changes:
        raise ValueError(f"{where}: {multiple} of the whole section says nothing; name its keys")
    return changes


def _merge(
    document: dict[str, Any], numbers: Mapping[str, Any], changes: Mapping[str, Any], where: str
) -> None:
    """Put changes into a section's document, in place; `numbers` is the document with all that it
    leaves open resolved."""
    for key, value in changes.items():
        told, place = numbers.get(key), f"{where}.{key}"
        if isinstance(value, Mapping) and isinstance(told, Mapping):
            inside = document.get(key)
            document[key] = inside = dict(inside) if isinstance(inside, Mapping) else {}
            _merge(inside, told, value, place)
        elif isinstance(value, str) and (match := _MULTIPLE.fullmatch(value)):
            document[key] = _multiple(float(match[1]), told, f"{place}: {value.strip()}")
        else:
            document[key] = value


def _multiple(factor: float, told: Any, where: str) -> Any:
    """Return a number, or each of several, times a factor."""
    if not _has_numbers(told):
        zero = told == 0 or (isinstance(told, tuple | list) and all(one == 0 for one in told))
        said = "says nothing; give a number" if zero else "is no number"
        raise ValueError(f"{where} of {told!r} {said}")
    return [factor * one for one in told] if isinstance(told, tuple | list) else factor * told


def _has_numbers(value: Any) -> bool:
    """Whether a value is a number other than zero, or several of which one is."""
    if isinstance(value, tuple | list):
        return all(_is_number(one) for one in value) and any(value)
    return _is_number(value) and bool(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _text(error: ValidationError, model: type[Section], prefix: str) -> str:
    from isogal.scenario.messages import describe  # which knows the scenario, and so this module

    return describe(error, model, prefix)
