"""What a replay needs of a bag, and whether it takes the readings as they were reduced when they
were recorded, or reduces the instrument's own anew.

Felt gravity is reduced with the navigator's velocity, and what is matched is taken for reduced
with that of the navigator that matches (docs/mathematics.md, section 2.6). A navigator that does
otherwise than the recorded one did needs readings of its own."""

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
from isogal_ros.messages.stamps import peek_ns, to_seconds

AIDS = (topics.BAROMETER, topics.VELOCITY)
"""Sensors beside the IMU that the filter may have."""
_KEYS = {
    "gravimeter": ("quantity", "interval"),
    "magnetometer": None,
    "altimeter": None,
    "gradiometer": ("components",),
}
"""Keys of the reduction by section; None = all."""
_WITHOUT = {
    topics.BAROMETER.name: "--set height.source=scenario",
    topics.VELOCITY.name: "--set velocity.kind=none",
}
"""What replays without a sensor beside the IMU, by its topic."""
LATE = 60.0
"""s after which the first IMU sample of a bag is not that of the scenario's start."""


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
    raw: tuple[dict[int, bytes], ...]
    """Readings of each field's instrument as it gave them by stamp."""
    reduces: bool
    """Whether these are reduced anew."""
    start: Start | None = None
    """Where the recorded navigator started; None = the bag does not say it."""
    of_another: bool = False
    """Whether felt gravity is fed that a navigator has reduced which may have done otherwise."""

    @property
    def first(self) -> float:
        """Stamp of the first IMU sample, s."""
        return to_seconds(min(self.imu))

    def readings(self) -> list[tuple[int, topics.Topic, bytes]]:
        """Return stamp, topic and message of the readings that are fed, in order of time."""
        each = [adapter_of(one) for one in self.scenario.each_field]
        if self.reduces:
            fed = [(one.raw, store) for one, store in zip(each, self.raw, strict=True)]
        else:
            stores = [self.collector.readings, *self.collector.others]
            fed = [(one.reduced, store) for one, store in zip(each, stores, strict=True)]
        found = [(ns, topic, data) for topic, store in fed for ns, data in store.items()]
        return sorted(found, key=lambda one: one[0])


def load(reader: BagReader, scenario: Scenario, changed: bool = False) -> Recorded:
    """Read a bag.

    Parameters
    ----------
    changed : bool
        Whether the filter has other parameters than the recorded one, whatever the scenario says.

    Raises
    ------
    InputError
        A topic that is needed is missing.
    """
    collector = Collector(scenario)
    imu: dict[int, bytes] = {}
    each = [adapter_of(one) for one in scenario.each_field]
    raw: tuple[dict[int, bytes], ...] = tuple({} for _ in each)
    aids: dict[topics.Topic, dict[int, bytes]] = {topic: {} for topic in AIDS}
    scalar: dict[int, bytes] = {}
    stores = {topics.IMU: imu, topics.SCALAR_FIELD: scalar, **aids}
    stores |= {one.raw: store for one, store in zip(each, raw, strict=True)}
    odometry: dict[int, bytes] = {}
    wanted = (*stores, topics.NAV_ODOM, *collector.topics())
    for topic, data in wanted_messages(reader, wanted):
        if topic in stores:
            stores[topic][peek_ns(data)] = data
        elif topic is topics.NAV_ODOM:
            odometry = odometry or {peek_ns(data): data}
        else:
            collector.take(topic, data)
    whole = all(raw) and not scalar
    recorded = reader.scenario()
    _check_reduction(reader.path, recorded, scenario, whole)
    differs = changed or recorded != scenario or to_seconds(min(imu, default=0)) > LATE
    reduces = differs and whole
    reduced = (collector.readings, *collector.others)
    needed = [(topics.IMU.name, imu)]
    for one, store, instead in zip(each, raw, reduced, strict=True):
        needed.append((one.raw.name, store) if reduces else (one.reduced.name, instead))
    needed += [(topic.name, aids[topic]) for topic in aids_of(scenario)]
    _check_there(reader, [name for name, store in needed if not store])
    run = int(reader.texts.get("run", 0))
    start = recorded_start(scenario, collector.first_nav, odometry, min(imu))
    felt = any(one.raw is topics.FELT for one in each)
    of_another = differs and felt and not reduces
    return Recorded(scenario, run, imu, collector, aids, raw, reduces, start, of_another)


def aids_of(scenario: Scenario) -> tuple[topics.Topic, ...]:
    """Return which of `AIDS` the filter of a scenario takes."""
    used = {
        topics.BAROMETER: scenario.height.measured,
        topics.VELOCITY: scenario.velocity.kind != "none",
    }
    return tuple(topic for topic in AIDS if used[topic])


def _check_there(reader: BagReader, missing: list[str]) -> None:
    """Raise InputError where topics are missing."""
    if not missing:
        return
    there = ", ".join(sorted(reader.types)) or "nothing"
    cut = f"; {reader.cut}" if reader.cut else ""
    keys = "".join(f"; {key} replays without" for name, key in _WITHOUT.items() if name in missing)
    raise InputError(
        f"{reader.path}: no messages on {' and '.join(missing)}, which a replay needs{keys}; the"
        f" bag has {there}{cut}"
    )


def _check_reduction(path: Path, recorded: Scenario | None, now: Scenario, raw: bool) -> None:
    """Look whether a scenario reduces readings otherwise than the recorded one did, and can.

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
        return
    before, after = _keys_of(recorded), _keys_of(now)
    changed = [key for key in after if key not in before or after[key] != before[key]]
    if not changed:
        return
    keys = ", ".join(changed)
    if not raw:
        raise InputError(
            f"{path}: a replay cannot change {keys}: the readings in the bag are reduced, and it"
            " has not all that the instrument measured"
        )
    for key in changed:
        if key.endswith("gravimeter.interval") and after[key] < before.get(key, 0.0):
            raise InputError(
                f"{path}: a replay cannot make {key} shorter than it was ({before[key]:g} s)"
            )


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
