"""``metadata.yaml`` of a bag, as rosbag2 writes it (version 9)."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from isogal.yaml_text import parse_yaml

FOREVER = {"sec": 9223372036, "nsec": 854775807}
"""rosbag2's infinite duration."""
_QOS_DEFAULTS: dict[str, Any] = {
    "history": "unknown",
    "depth": 0,
    "reliability": "reliable",
    "durability": "volatile",
    "deadline": FOREVER,
    "lifespan": FOREVER,
    "liveliness": "automatic",
    "liveliness_lease_duration": FOREVER,
    "avoid_ros_namespace_conventions": False,
}


@dataclass
class RecordedTopic:
    """One topic of a bag."""

    channel: int
    """Its number in the file."""
    type: str
    qos: list[dict[str, Any]]
    """Offered profiles, see `qos_entries`."""
    type_hash: str
    count: int = 0
    """Messages written."""


@dataclass
class Contents:
    """What a bag holds so far."""

    file: str
    """Name of its MCAP file."""
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    """By name."""
    messages: int = 0
    first: int | None = None
    """Earliest log time, ns."""
    last: int = 0
    """Latest log time, ns."""
    earlier: list[dict[str, Any]] = field(default_factory=list)
    """Entries of the bag's files before this one, as ``metadata.yaml`` has them."""

    def count(self, topic: RecordedTopic, log_ns: int) -> None:
        """Count a message."""
        topic.count += 1
        self.messages += 1
        self.first = log_ns if self.first is None else min(self.first, log_ns)
        self.last = max(self.last, log_ns)

    def information(self) -> dict[str, Any]:
        """Return what ``metadata.yaml`` says under ``rosbag2_bagfile_information``."""
        start = self.first or 0
        span = {
            "duration": {"nanoseconds": max(0, self.last - start)},
            "starting_time": {"nanoseconds_since_epoch": start},
        }
        topics = [
            {
                "topic_metadata": {
                    "name": name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.qos,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for name, topic in self.topics.items()
        ]
        return {
            "version": 9,
            "storage_identifier": "mcap",
            **span,
            "message_count": self.messages + sum(entry["message_count"] for entry in self.earlier),
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [*(entry["path"] for entry in self.earlier), self.file],
            "files": [
                *self.earlier,
                {"path": self.file, **span, "message_count": self.messages},
            ],
            "custom_data": None,
            "ros_distro": "jazzy",
        }


def earlier_files(folder: Path, files: Sequence[Path]) -> list[dict[str, Any]]:
    """Return the entries of files that ``metadata.yaml`` in a folder has; of others what there is
    to say without reading them."""
    known: dict[str, dict[str, Any]] = {}
    with suppress(OSError, ValueError, KeyError, TypeError):
        text = (folder / "metadata.yaml").read_text(encoding="utf-8")
        document = parse_yaml(text, "metadata.yaml")
        for entry in document["rosbag2_bagfile_information"]["files"]:
            if isinstance(entry["message_count"], int):
                known[entry["path"]] = entry
    nothing = {
        "starting_time": {"nanoseconds_since_epoch": 0},
        "duration": {"nanoseconds": 0},
        "message_count": 0,
    }
    return [known.get(file.name, {"path": file.name, **nothing}) for file in files]


def qos_entries(profiles: Sequence[Any]) -> list[dict[str, Any]]:
    """Return offered QoS profiles as rosbag2 writes them (names in lower case since metadata
    version 9)."""
    result = []
    for profile in profiles:
        entry = dict(_QOS_DEFAULTS)
        for name in ("history", "reliability", "durability", "liveliness"):
            entry[name] = getattr(profile, name).name.lower()
        entry["depth"] = int(profile.depth)
        for name in ("deadline", "lifespan", "liveliness_lease_duration"):
            ns = getattr(profile, name).nanoseconds
            if 0 < ns < 2**63 - 1:  # zero stands for the middleware's default, which is forever
                seconds, rest = divmod(ns, 1_000_000_000)
                entry[name] = {"sec": seconds, "nsec": rest}
        result.append(entry)
    return result


def yaml_text(value: Any) -> str:
    """Return YAML as rosbag2 writes it."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, width=1000)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes equal values out each time: rosbag2 does not read anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        """Say so."""
        return True
