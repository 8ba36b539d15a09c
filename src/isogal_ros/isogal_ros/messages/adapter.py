"""The messages of a field: what its instrument publishes, and what is published of a reading once
it is reduced.

Each field has an adapter between its messages and arrays, registered by the field's name as an
entry point of the group ``isogal.message_adapters`` (`isogal.plugins`): a function that takes the
scenario and returns an `Adapter`. A package may so add the messages of its own field.

Values and variances are in the unit of the field's maps (m/s², nT, m, 1/s²); messages have those
of their definitions (m/s², T, m). Readers raise `BadMessageError` for what cannot be used."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from isogal import plugins
from isogal.arrays import Array
from isogal.fields.measured import measured_field, of_instrument
from isogal.scenario import Assumed
from isogal_ros import topics
from isogal_ros.messages.aids import each_aid
from isogal_ros.messages.ins_solution import inertial_topics
from isogal_ros.topics import Message, Topic

Reading = float | Array
"""A number, or an array (C,) of several channels; its variance, or their covariance (C, C)."""
Place = tuple[float, float] | None
"""Latitude and longitude (rad) where the navigator took a reading to be; None = not known."""
Write = Callable[[int, Reading, Reading, Place], Message]
"""Returns the message of a stamp (ns), a reading (NaN = nothing in range), its variance and the
place, which instruments do not know."""


@dataclass(frozen=True)
class Adapter:
    """Messages of one field. All of them have a header."""

    raw: Topic
    """What the instrument publishes."""
    write_raw: Write
    """Of the simulated instrument."""
    read_raw: Callable[[Message], tuple[Reading, Reading | None]]
    """Returns (what was sensed, NaN = nothing in range; its variance, None = unknown)."""
    reduced: Topic
    """What is matched."""
    write_reduced: Write
    read_reduced: Callable[[Message], tuple[Reading, Reading]]
    """Returns (reduced reading, NaN = the instrument had none in range; variance)."""


def adapter_of(assumed: Assumed, field: str | None = None) -> Adapter:
    """Return the adapter of a field, by default of the one that the scenario matches.

    Raises
    ------
    InputError
        No installed package has an adapter for the field.
    """
    make = plugins.load(plugins.MESSAGE_ADAPTERS, field or assumed.measured_field)
    return make(assumed)


def adapters_of(assumed: Assumed) -> Iterator[Adapter]:
    """Yield the adapters of all that a graph's instruments publish."""
    for one in assumed.each_field:
        for field in of_instrument(measured_field(one).instrument):
            yield adapter_of(one, field.name)


def topics_in_use(assumed: Assumed) -> tuple[Topic, ...]:
    """Return the topics of a graph, with those of the instruments and aids that the scenario
    has."""
    found = [*topics.OF_EVERY_GRAPH, *inertial_topics(assumed.ins)]
    found += [topic for one in adapters_of(assumed) for topic in (one.raw, one.reduced)]
    if topics.MAGNETIC_FIELD in found:
        found.append(topics.SCALAR_FIELD)
    found += [topic for aid in each_aid(assumed) for topic in (aid.topic, *aid.instead)]
    if assumed.fusion.lag > 0.0:
        found.append(topics.SMOOTHED)
    if assumed.ins.gives_solution:
        found.append(topics.INS_ERROR)
    return tuple(dict.fromkeys(found))
