"""``metadata.yaml`` of a bag, as rosbag2 writes it (version 9)."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import JsonValue
from rclpy.duration import Duration
from rclpy.qos import QoSProfile

from isogal.yaml_text import parse_yaml

Entry = dict[str, JsonValue]


@dataclass
class RecordedTopic:
    """One topic of a bag."""

    channel: int
    """Its number in the file."""
    type: str
    qos: list[JsonValue]
    """Offered profiles, see `qos_entries`."""
    type_hash: str
    count: int = 0
    """Messages written."""


def information(files: Sequence[Entry], topics: Mapping[str, RecordedTopic]) -> Entry:
    """Return what ``metadata.yaml`` says under ``rosbag2_bagfile_information``.

    Parameters
    ----------
    files : sequence of Entry
        What it says of each file, the last of which is the one that is written; `file_entry`.
    topics : mapping
        Those of the last file, by name.
    """
    counts = (entry["message_count"] for entry in files)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": files[-1]["duration"],
        "starting_time": files[-1]["starting_time"],
        "message_count": sum(count for count in counts if isinstance(count, int)),
        "topics_with_message_count": [
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
            for name, topic in topics.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [entry["path"] for entry in files],
        "files": [*files],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def file_entry(path: str, first: int, last: int, messages: int) -> Entry:
    """Return what ``metadata.yaml`` says of a file: its name, earliest and latest log time (ns),
    and number of messages."""
    return {
        "path": path,
        "starting_time": {"nanoseconds_since_epoch": first},
        "duration": {"nanoseconds": max(0, last - first)},
        "message_count": messages,
    }


def earlier_files(folder: Path, files: Sequence[Path]) -> list[Entry]:
    """Return what ``metadata.yaml`` in a folder says of files there; of others their names."""
    known: dict[str, Entry] = {}
    with suppress(OSError, ValueError, KeyError, TypeError):
        text = (folder / "metadata.yaml").read_text(encoding="utf-8")
        document = parse_yaml(text, "metadata.yaml")
        known = {one["path"]: one for one in document["rosbag2_bagfile_information"]["files"]}
    return [known.get(file.name, file_entry(file.name, 0, 0, 0)) for file in files]


def qos_entries(profiles: Iterable[QoSProfile]) -> list[JsonValue]:
    """Return offered QoS profiles as rosbag2 writes them (names in lower case since metadata
    version 9)."""
    return [
        {
            "history": profile.history.name.lower(),
            "depth": int(profile.depth),
            "reliability": profile.reliability.name.lower(),
            "durability": profile.durability.name.lower(),
            "deadline": _duration(profile.deadline),
            "lifespan": _duration(profile.lifespan),
            "liveliness": profile.liveliness.name.lower(),
            "liveliness_lease_duration": _duration(profile.liveliness_lease_duration),
            "avoid_ros_namespace_conventions": False,
        }
        for profile in profiles
    ]


def _duration(duration: Duration) -> Entry:
    """Return a duration; zero stands for the middleware's default, which is forever."""
    ns = duration.nanoseconds if duration.nanoseconds > 0 else 2**63 - 1
    seconds, rest = divmod(ns, 1_000_000_000)
    return {"sec": seconds, "nsec": rest}
