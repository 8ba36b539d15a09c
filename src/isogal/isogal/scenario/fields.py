"""Several fields in one run: the list `fields`, whose entries say what of the scenario is another
for each of them.

An entry is the scenario with some keys changed: its field, instrument, map, map error, and what
its matcher assumes. What an entry does not say of `map` and `matcher` is as the scenario itself
says; the sections whose numbers are in the unit of a field, `gravimeter` and `map_error`, have
their defaults and count in entries only."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field, ValidationError

from isogal import plugins
from isogal.scenario.instruments import Gravimeter
from isogal.scenario.section import Positive, Section
from isogal.scenario.world import MapError
from isogal.seeds import generator

if TYPE_CHECKING:
    from isogal.scenario.model import Scenario

FieldName = Annotated[str, AfterValidator(partial(plugins.check, plugins.FIELDS))]
MERGED = ("gravimeter", "map", "map_error", "matcher", "truth")
"""Sections that an entry may change key by key."""
OF_FIELDS = ("gravimeter", "magnetometer", "altimeter", "gradiometer", "map")
"""Sections of `truth` that are about readings and maps, and so about entries."""
_DEFAULTS = {"gravimeter": Gravimeter(), "map_error": MapError(), "field": None}


class FieldEntry(Section):
    """One of several fields."""

    field: FieldName = Field(description="field that is measured and matched")
    name: str | None = Field(
        None, pattern=r"^[a-z][a-z0-9_]*$", description="what it is called; null = as its field"
    )
    seed: int | None = Field(
        None,
        ge=0,
        description="of the random streams of its readings; null = the first: seed, others: drawn",
    )
    sigma: Positive | None = Field(
        None, description="gravimeter.sigma: white noise of a reading, in the field's unit"
    )
    interval: Positive | None = Field(None, description="gravimeter.interval: s between scans")
    gravimeter: dict[str, Any] = Field(
        default_factory=dict, description="other keys of its instrument, as the section gravimeter"
    )
    map: dict[str, Any] = Field(
        default_factory=dict, description="keys of the section map that are others for it"
    )
    map_error: dict[str, Any] = Field(
        default_factory=dict, description="keys of the section map_error, in the field's unit"
    )
    matcher: dict[str, Any] = Field(
        default_factory=dict, description="keys of the section matcher that are others for it"
    )
    truth: dict[str, Any] = Field(
        default_factory=dict, description="keys of the section truth that are others for it"
    )

    @property
    def called(self) -> str:
        """Its name, or that of its field."""
        return self.name or self.field

    @property
    def instrument(self) -> dict[str, Any]:
        """What it says of the section `gravimeter`."""
        short = {"sigma": self.sigma, "interval": self.interval}
        return self.gravimeter | {key: x for key, x in short.items() if x is not None}


def read_entries(documents: Sequence[Mapping[str, Any]]) -> tuple[FieldEntry, ...]:
    """Return the entries of a list `fields`; raises ValueError with a line that names the key."""
    entries = []
    for index, document in enumerate(documents):
        try:
            entries.append(FieldEntry.model_validate(document))
        except ValidationError as error:
            raise ValueError(_text(error, FieldEntry, f"fields.{index}.")) from None
    names = [entry.called for entry in entries]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"fields: two entries are called '{name}'; give each another name")
    if not entries:
        raise ValueError("fields: must have an entry for each field, or be null")
    return tuple(entries)


def scenarios_of(scenario: "Scenario") -> tuple["Scenario", ...]:
    """Return the scenario of each entry of `fields`: that of a run in which this field alone is
    matched.

    Raises
    ------
    ValueError
        One line: a key that an entry cannot have, or that says nothing beside a list.
    """
    assert scenario.fields is not None
    for key, default in _DEFAULTS.items():
        if getattr(scenario, key) != default:
            raise ValueError(f"{key}: says nothing beside fields; give it in the entries")
    entries = read_entries(scenario.fields)
    return tuple(_scenario_of(scenario, index, entry) for index, entry in enumerate(entries))


def _scenario_of(scenario: "Scenario", index: int, entry: FieldEntry) -> "Scenario":
    kind = type(scenario)
    changes: dict[str, Any] = {"fields": None, "field": entry.field}
    for key in MERGED:
        told: Any = getattr(scenario, key)
        own: dict[str, Any] = entry.instrument if key == "gravimeter" else getattr(entry, key)
        document: dict[str, Any] = told if isinstance(told, dict) else told.model_dump()
        changes[key] = _merged(document, own)
    if index or entry.seed is not None:
        changes["seed"] = _seed(scenario.seed, entry)
    if scenario.samples_per_step > 1:
        changes["fusion"] = scenario.fusion.model_dump() | {"rate": scenario.navigation_rate}
    values = {name: getattr(scenario, name) for name in kind.model_fields}
    try:
        return kind.model_validate(values | changes)
    except ValidationError as error:
        raise ValueError(_text(error, kind, f"fields.{index}.")) from None


def intervals_of(documents: Sequence[Mapping[str, Any]]) -> list[float]:
    """Return the time (s) between the scans of each entry."""
    default = Gravimeter().interval
    told = [entry.instrument.get("interval", default) for entry in read_entries(documents)]
    return [float(interval) for interval in told]


def _seed(seed: int, entry: FieldEntry) -> int:
    """Return the seed of an entry's random streams: of no two entries the same, so that their
    noise and the errors of their maps are independent."""
    if entry.seed is not None:
        return entry.seed
    return int(generator(seed, 0, f"field {entry.called}").integers(2**31))


def _merged(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(document)
    for key, value in changes.items():
        inside = result.get(key)
        section = isinstance(inside, dict) and isinstance(value, dict)
        result[key] = _merged(dict(inside or {}), value) if section else value
    return result


def _text(error: ValidationError, model: type[Section], prefix: str) -> str:
    from isogal.scenario.messages import describe  # which knows the scenario, and so this module

    return describe(error, model, prefix)
