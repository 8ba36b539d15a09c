"""The messages of a field: what its instrument publishes, and what is published of a reading once
it is reduced.

Each field has an adapter between its messages and arrays, registered by the field's name as an
entry point of the group ``isogal.message_adapters`` (`isogal.plugins`): a function that takes the
scenario and returns an `Adapter`. A package may so add the messages of its own field.

Values and variances are in the unit of the field's maps (m/s², nT, m, 1/s²); messages have those
of their definitions (m/s², T, m). A reading of several channels is an array (C,) with a covariance
(C, C) instead of a number and its variance. Readers raise `BadMessageError` for what cannot be
used."""

from typing import Any, Protocol

from isogal import plugins
from isogal.fields.measured import measured_field, of_instrument
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.frames import framed
from isogal_ros.topics import Topic

Place = tuple[float, float] | None
"""Latitude and longitude (rad) where the navigator took a reading to be; None = not known."""


class Adapter(Protocol):
    """Messages of one field. All of them have a header."""

    raw: Topic
    """What the instrument publishes."""
    reduced: Topic
    """What is matched."""

    def new_raw(self) -> Any:
        """Return a raw message of the simulated instrument, to be filled."""
        ...

    def fill_raw(self, message: Any, ns: int, value: Any, variance: Any) -> None:
        """Write what is felt (NaN = nothing in range) into a raw message."""
        ...

    def read_raw(self, message: Any) -> tuple[Any, Any | None]:
        """Return (what was felt, NaN = nothing in range; its variance, None = unknown)."""
        ...

    def new_reduced(self) -> Any:
        """Return a message for reduced readings, to be filled."""
        ...

    def fill_reduced(self, message: Any, ns: int, value: Any, variance: Any, place: Place) -> None:
        """Write a reduced reading (NaN = none) into its message."""
        ...

    def read_reduced(self, message: Any) -> tuple[Any, Any]:
        """Return (reduced reading, NaN = the instrument had none in range; variance)."""
        ...


class Framed:
    """Messages of an adapter of Isogal's own, before they are filled."""

    raw: Topic
    reduced: Topic
    frames: tuple[str, str]
    """Of raw and of reduced messages."""

    def new_raw(self) -> Any:
        """Return a raw message of the simulated instrument, to be filled."""
        return framed(self.raw, self.frames[0])

    def new_reduced(self) -> Any:
        """Return a message for reduced readings, to be filled."""
        return framed(self.reduced, self.frames[1])


def adapter_of(scenario: Scenario, field: str | None = None) -> Adapter:
    """Return the adapter of a field, by default of the one that the scenario matches.

    Raises
    ------
    InputError
        No installed package has an adapter for the field.
    """
    make = plugins.load(plugins.MESSAGE_ADAPTERS, field or scenario.measured_field)
    adapter: Adapter = make(scenario)
    return adapter


def all_topics(scenario: Scenario) -> tuple[Topic, ...]:
    """Return the topics of a graph: Isogal's own, and those of the scenario's instrument if
    another package has added it."""
    found = dict.fromkeys(topics.ALL)
    for one in scenario.each_field:
        for field in of_instrument(measured_field(one).instrument):
            adapter = adapter_of(one, field.name)
            found |= dict.fromkeys((adapter.raw, adapter.reduced))
    return tuple(found)


def topics_in_use(scenario: Scenario) -> tuple[Topic, ...]:
    """Return the topics of a graph without those of instruments and aids that the scenario does
    not have."""
    adapters = [
        adapter_of(one, field.name)
        for one in scenario.each_field
        for field in of_instrument(measured_field(one).instrument)
    ]
    own = {topic for adapter in adapters for topic in (adapter.raw, adapter.reduced)}
    others = {*topics.OF_INSTRUMENTS} - own
    if topics.MAGNETIC_FIELD in own:
        others.discard(topics.SCALAR_FIELD)
    if scenario.height.source == "scenario":
        others.add(topics.BAROMETER)
    if scenario.velocity.kind == "none":
        others.add(topics.VELOCITY)
    return tuple(topic for topic in all_topics(scenario) if topic not in others)
