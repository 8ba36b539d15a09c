"""What a replay needs of a bag, and whether it takes the readings as they were reduced when they
were recorded, or reduces the instrument's own anew."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.collect import Collector, wanted_messages
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.recorded_start import Start, recorded_start
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import peek_ns

AIDS = (topics.BAROMETER, topics.VELOCITY)
"""Sensors beside the IMU that the filter may have."""
_KEYS = {
    "gravimeter": ("quantity", "interval"),
    "magnetometer": None,
    "altimeter": None,
    "gradiometer": ("components",),
}
"""Keys of the reduction by section; None = all."""


@dataclass(frozen=True)
class Recorded:
    """What a replay needs of a bag."""

    scenario: Scenario
    run: int
    imu: dict[int, bytes]
    """Serialised messages by stamp."""
    collector: Collector
    aids: dict[topics.Topic, dict[int, bytes]]
    """Readings of height and velocity sensors by stamp."""
    raw: dict[int, bytes]
    """Readings of the instrument as it gave them by stamp."""
    reduces: bool
    """Whether these are reduced anew."""
    start: Start | None = None
    """Where the recorded navigator started; None = the bag does not say it."""

    def readings(self) -> list[tuple[int, topics.Topic, bytes]]:
        """Return stamp, topic and message of the readings that are fed, in order of time."""
        each = [adapter_of(one) for one in self.scenario.each_field]
        stores = [self.collector.readings, *self.collector.others]
        fed = [(one.reduced, store) for one, store in zip(each, stores, strict=True)]
        if self.reduces:
            fed = [(each[0].raw, self.raw)]
        found = [(ns, topic, data) for topic, store in fed for ns, data in store.items()]
        return sorted(found, key=lambda one: one[0])


def load(reader: BagReader, scenario: Scenario) -> Recorded:
    """Read a bag.

    Raises
    ------
    InputError
        A topic that is needed is missing.
    """
    collector = Collector(scenario)
    imu: dict[int, bytes] = {}
    raw: dict[int, bytes] = {}
    adapter, *others = (adapter_of(one) for one in scenario.each_field)
    aids: dict[topics.Topic, dict[int, bytes]] = {topic: {} for topic in AIDS}
    scalar: dict[int, bytes] = {}
    stores = {topics.IMU: imu, adapter.raw: raw, topics.SCALAR_FIELD: scalar, **aids}
    odometry: dict[int, bytes] = {}
    wanted = (*stores, topics.NAV_ODOM, *collector.topics())
    for topic, data in wanted_messages(reader, wanted):
        if topic in stores:
            stores[topic][peek_ns(data)] = data
        elif topic is topics.NAV_ODOM:
            odometry = odometry or {peek_ns(data): data}
        else:
            collector.take(topic, data)
    whole = bool(raw) and not scalar and not others
    reduces = _reduces_anew(reader.path, reader.scenario(), scenario, whole)
    readings = (adapter.raw, raw) if reduces else (adapter.reduced, collector.readings)
    needed = [(topics.IMU.name, imu), (readings[0].name, readings[1])]
    more = zip(others, collector.others, strict=True)
    needed += [(other.reduced.name, store) for other, store in more]
    missing = [name for name, store in needed if not store]
    if missing:
        there = ", ".join(sorted(reader.types)) or "nothing"
        cut = f"; {reader.cut}" if reader.cut else ""
        raise InputError(
            f"{reader.path}: no messages on {' and '.join(missing)}, which a replay needs; the bag"
            f" has {there}{cut}"
        )
    run = int(reader.texts.get("run", 0))
    start = recorded_start(scenario, collector.first_nav, odometry, min(imu))
    return Recorded(scenario, run, imu, collector, aids, raw, reduces, start)


def _reduces_anew(path: Path, recorded: Scenario | None, now: Scenario, raw: bool) -> bool:
    """Return whether a scenario reduces readings otherwise than the recorded one did; one that is
    not known did not.

    Parameters
    ----------
    raw : bool
        Whether the bag has the instrument's own readings, and nothing else is needed.

    Raises
    ------
    InputError
        It does, and cannot with this bag.
    """
    if recorded is None:
        return False
    before, after = _keys_of(recorded), _keys_of(now)
    changed = [key for key in after if key not in before or after[key] != before[key]]
    if not changed:
        return False
    keys = ", ".join(changed)
    if not raw:
        raise InputError(
            f"{path}: a replay cannot change {keys}: the readings in the bag are reduced, and it"
            " has not all that the instrument measured"
        )
    if now.gravimeter.interval < recorded.gravimeter.interval:
        raise InputError(
            f"{path}: a replay cannot make gravimeter.interval shorter than it was"
            f" ({recorded.gravimeter.interval:g} s)"
        )
    return True


def _keys_of(scenario: Scenario) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for number, one in enumerate(scenario.each_field):
        prefix = "" if scenario.fields is None else f"fields.{number}."
        document = one.model_dump()
        found[f"{prefix}field"] = document["field"]
        for section, keys in _KEYS.items():
            values = document[section]
            found |= {f"{prefix}{section}.{key}": values[key] for key in keys or values}
    return found
