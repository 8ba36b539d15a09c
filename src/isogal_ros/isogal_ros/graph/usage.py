"""What a replay has used of what it was fed, and why not of the rest."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.graph.recorded import Recorded, aids_of
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.topics import Topic

_PARAMETERS = "; a replay takes parameters of ukf_fusion_node by --parameter NAME=VALUE"
_NO_PARAMETER = "; no parameter sets that frame: the messages must have it"


@dataclass(frozen=True)
class Fed:
    """What the nodes of a replay were fed, and what they said of it."""

    answered: int
    """Stamp of the last IMU sample that was answered, ns; 0 = none."""
    readings: int
    """Readings that were published."""
    navigates: bool
    """Whether the filter has published a state."""
    filter_state: str
    """What the filter said of itself at the end."""
    dropped: dict[str, int]
    """Messages that were dropped by topic, of all nodes."""
    why: dict[str, str]
    """Why the last of them was."""
    aid_counts: dict[str, int]
    """Readings of sensors beside the IMU that the filter used by topic."""

    @classmethod
    def to(cls, nodes: Mapping[str, Any], answered: int, readings: int) -> "Fed":
        """Return what nodes, by name, tell at the end."""
        dropped: dict[str, int] = {}
        why: dict[str, str] = {}
        for node in nodes.values():
            for topic, count in node.health.dropped.items():
                dropped[topic] = dropped.get(topic, 0) + count
            why |= node.health.why
        fusion = nodes[topics.UKF_FUSION]
        figures = fusion.health.figures
        aids = (topics.BAROMETER.name, topics.VELOCITY.name)
        return cls(
            answered,
            readings,
            fusion.outputs.reached >= 0,
            fusion.health.message,
            dropped,
            why,
            {name: figures.get(f"{name} used", 0) for name in aids},
        )


def shortcomings(recorded: Recorded, fed: Fed, outputs: Collector) -> list[str]:
    """Return one line for each sensor of which no message was used, and one where there was no
    fix."""
    found = []
    count = len(recorded.imu)
    if not fed.navigates or fed.dropped.get(topics.IMU.name, 0) >= count:
        found.append(f"{_unused(topics.IMU, count, fed, fed.filter_state)}{_PARAMETERS}")
    for topic in aids_of(recorded.scenario):
        if not fed.aid_counts[topic.name]:
            why = "the filter had no state to which it could apply them"
            found.append(f"{_unused(topic, len(recorded.aids[topic]), fed, why)}{_PARAMETERS}")
    found += _readings(recorded, fed)
    if all(place is None for place in outputs.fix_positions().values()):
        found.append(f"no fix: {_why_no_fix(recorded, outputs)}")
    return found


def _readings(recorded: Recorded, fed: Fed) -> list[str]:
    """Say of which instruments no reading was used."""
    found = []
    stamps: dict[Topic, list[int]] = {}
    for ns, topic, _ in recorded.readings():
        stamps.setdefault(topic, []).append(ns)
    for topic, each in stamps.items():
        if min(each) > fed.answered:
            why = f"the first is of {to_seconds(min(each)):.0f} s, after the last IMU sample"
            found.append(_unused(topic, len(each), fed, why))
        elif fed.dropped.get(topic.name, 0) >= sum(ns <= fed.answered for ns in each):
            key = _NO_PARAMETER if fed.why[topic.name].startswith("frame_id ") else ""
            found.append(_unused(topic, len(each), fed, "") + key)
    return found


def _unused(topic: Topic, count: int, fed: Fed, otherwise: str) -> str:
    """Say that none of a topic's messages was used, and why: as the last that was dropped, or
    otherwise."""
    dropped = fed.dropped.get(topic.name, 0)
    why = f"{dropped} dropped: {fed.why[topic.name]}" if dropped else otherwise
    return f"{topic.name}: none of {count} messages was used: {why}"


def _why_no_fix(recorded: Recorded, outputs: Collector) -> str:
    """Say why no batch gave a fix."""
    reasons = Counter(figures["message"] for figures in outputs.batches.values())
    if not reasons:
        fields = recorded.scenario.each_field
        lengths = ", ".join(str(one.matcher.batch_length) for one in fields)
        return f"no batch ended (matcher.batch_length: {lengths} scans)"
    (reason, count), *others = reasons.most_common()
    more = f"; {len(others)} other reasons" if others else ""
    return f"{sum(reasons.values())} batches gave none: {reason} ({count} times){more}"
