"""Objects that packages add to Isogal by name, found through their entry points.

A package names an object in its metadata (`pyproject.toml` or `setup.py`), under one of the groups
below; from then on scenarios, the command line and the nodes know it by that name. Isogal's own
objects are registered in the same way.

``isogal.matchers``
    A class that follows `isogal.matching.interfaces.Matcher` and is built by its class method
    ``from_settings`` from the scenario's section ``matcher``.
``isogal.map_formats``
    A format of map files or folders.
``isogal.fields``
    A field that can be measured and matched.
``isogal.message_adapters``
    The ROS messages of a field; has the field's name.

Looking names up reads the metadata of the installed packages and imports none of them."""

import difflib
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from isogal.errors import InputError

T = TypeVar("T")

MATCHERS = "isogal.matchers"
MAP_FORMATS = "isogal.map_formats"
FIELDS = "isogal.fields"
MESSAGE_ADAPTERS = "isogal.message_adapters"

_NOUNS = {
    MATCHERS: "matcher",
    MAP_FORMATS: "map format",
    FIELDS: "field",
    MESSAGE_ADAPTERS: "message adapter",
}
_OWN = ("isogal", "isogal_ros")
_installed = cache(entry_points)  # reads the metadata of every package: once is enough


def names(group: str) -> tuple[str, ...]:
    """Return the names of a group: Isogal's own first, then others, each in alphabetical order.

    Raises
    ------
    InputError
        Two packages use the same name.
    """
    return tuple(_registered(group))


def check(group: str, name: str) -> str:
    """Return the name if the group has it; raises InputError with the nearest and all allowed."""
    known = names(group)
    if name in known:
        return name
    close = difflib.get_close_matches(name, known, n=1)
    nearest = f" (did you mean '{close[0]}'?)" if close else ""
    allowed = ", ".join(known) or f"none, as no installed package registers any in {group}"
    raise InputError(f"unknown {_NOUNS[group]} '{name}'{nearest}; allowed: {allowed}")


def load(group: str, name: str, kind: type = object) -> Any:
    """Import and return the object that a group has under a name.

    Raises
    ------
    InputError
        There is no such name, its package cannot be imported, or the object is not of a kind.
    """
    found = _imported(_registered(group)[check(group, name)])
    if not isinstance(found, kind):
        raise InputError(
            f"{_NOUNS[group]} '{name}': its package gives no {kind.__module__}.{kind.__qualname__}"
        )
    return found


def says(group: str, name: str, attribute: str, otherwise: T) -> T:
    """Return what the object that a group has under a name says in an attribute, or in its place
    where it has none; raises as `load`."""
    found: T = getattr(load(group, name), attribute, otherwise)
    return found


@cache
def _imported(entry: EntryPoint) -> object:
    try:
        return entry.load()
    except Exception as error:
        raise InputError(
            f"{_NOUNS[entry.group]} '{entry.name}' of the package {_package(entry)} cannot be"
            f" imported: {type(error).__name__}: {error}"
        ) from error


@cache
def _registered(group: str) -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for entry in sorted(_installed().select(group=group), key=_order):
        if entry.name in found:
            raise InputError(
                f"{_NOUNS[group]} '{entry.name}': both {_package(found[entry.name])} and"
                f" {_package(entry)} provide it; uninstall one of the packages"
            )
        found[entry.name] = entry
    return found


def _order(entry: EntryPoint) -> tuple[bool, str, str]:
    return entry.module.partition(".")[0] not in _OWN, entry.name, entry.value


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.module
