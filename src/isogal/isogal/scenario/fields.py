"""Several fields in one run: the list `fields`, whose entries say what of the scenario is another
for each of them.

An entry is the scenario with some keys changed: its field, instrument, map, map error, and what
its matcher assumes. What an entry does not say of `map` and `matcher` is as the scenario itself
says; the sections whose numbers are in the unit of a field, `gravimeter` and `map_error`, have
their defaults and count in entries only."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, TypeVar

from pydantic import AfterValidator, Field

from isogal import plugins
from isogal.scenario.instruments import Gravimeter
from isogal.scenario.map import MapError
from isogal.scenario.section import Document, Positive, Section, merged, validated
from isogal.seeds import generator

if TYPE_CHECKING:
    from isogal.scenario.model import Assumed

_Assumed = TypeVar("_Assumed", bound="Assumed")
FieldName = Annotated[str, AfterValidator(partial(plugins.check, plugins.FIELDS))]
MERGED = ("gravimeter", "readings", "map", "map_error", "matcher", "truth")
"""Sections that an entry may change key by key."""
OF_FIELDS = ("gravimeter", "magnetometer", "altimeter", "gradiometer", "map")
"""Sections of `truth` that are about readings and maps, and so about entries."""
_DEFAULTS = {"gravimeter": Gravimeter(), "map_error": MapError(), "field": None}


class FieldEntry(Section):
    """One of several fields."""

    field: FieldName
    """field that is measured and matched"""
    name: str | None = Field(None, pattern=r"^[a-z][a-z0-9_]*$")
    """what it is called; null = as its field"""
    seed: int | None = Field(None, ge=0)
    """of the random streams of its readings; null = the first: seed, others: drawn"""
    sigma: Positive | None = None
    """gravimeter.sigma: white noise of a reading, in the field's unit"""
    interval: Positive | None = None
    """gravimeter.interval: s between scans"""
    gravimeter: Document = Field(default_factory=dict)
    """other keys of its instrument, as the section gravimeter"""
    readings: Document = Field(default_factory=dict)
    """keys of the section readings that are others for it"""
    map: Document = Field(default_factory=dict)
    """keys of the section map that are others for it"""
    map_error: Document = Field(default_factory=dict)
    """keys of the section map_error, in the field's unit"""
    matcher: Document = Field(default_factory=dict)
    """keys of the section matcher that are others for it"""
    truth: Document = Field(default_factory=dict)
    """keys of the section truth that are others for it"""

    @property
    def called(self) -> str:
        """Its name, or that of its field."""
        return self.name or self.field

    @property
    def instrument(self) -> Document:
        """What it says of the section `gravimeter`."""
        short = {"sigma": self.sigma, "interval": self.interval}
        return self.gravimeter | {key: x for key, x in short.items() if x is not None}


def read_entries(documents: Sequence[Document]) -> tuple[FieldEntry, ...]:
    """Return the entries of a list `fields`; raises ValueError with a line that names the key."""
    entries = tuple(
        validated(FieldEntry, document, f"fields.{index}.")
        for index, document in enumerate(documents)
    )
    names = [entry.called for entry in entries]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"fields: two entries are called '{name}'; give each another name")
    if not entries:
        raise ValueError("fields: must have an entry for each field, or be null")
    return entries


def settings_of(settings: _Assumed) -> tuple[_Assumed, ...]:
    """Return the settings of each entry of `fields`: those of a run in which this field alone is
    matched.

    Raises
    ------
    ValueError
        One line: a key that an entry cannot have, or that says nothing beside a list.
    """
    assert settings.fields is not None
    for key, default in _DEFAULTS.items():
        if getattr(settings, key) != default:
            raise ValueError(f"{key}: says nothing beside fields; give it in the entries")
    entries = read_entries(settings.fields)
    return tuple(_of_entry(settings, index, entry) for index, entry in enumerate(entries))


def _of_entry(settings: _Assumed, index: int, entry: FieldEntry) -> _Assumed:
    changes: Document = {"fields": None, "field": entry.field}
    for key in (one for one in MERGED if one in type(settings).model_fields):
        section: Section | Document = getattr(settings, key)
        own: Document = entry.instrument if key == "gravimeter" else getattr(entry, key)
        whole = section.model_dump() if isinstance(section, Section) else section
        changes[key] = merged(whole, own)
    if index or entry.seed is not None:
        changes["seed"] = _seed(settings.seed, entry)
    if settings.samples_per_step > 1:
        changes["fusion"] = settings.fusion.model_dump() | {"rate": settings.navigation_rate}
    return validated(type(settings), dict(settings) | changes, f"fields.{index}.")


def intervals_of(documents: Sequence[Document]) -> list[float]:
    """Return the time (s) between the scans of each entry."""
    default = Gravimeter().interval
    entries = read_entries(documents)
    return [float(entry.instrument.get("interval", default)) for entry in entries]


def _seed(seed: int, entry: FieldEntry) -> int:
    """Return the seed of an entry's random streams: of no two entries the same, so that their
    noise and the errors of their maps are independent."""
    if entry.seed is not None:
        return entry.seed
    return int(generator(seed, 0, f"field {entry.called}").integers(2**31))
