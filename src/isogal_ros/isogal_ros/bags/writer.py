"""Writing recordings as ``ros2 bag record -s mcap`` lays them out: a folder with one MCAP file and
``metadata.yaml``.

The file is written in small chunks straight to the disk, and the scenario goes first: whoever
kills the recorder leaves a file that can be read up to the last whole chunk
(`isogal_ros.bags.reader`)."""

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from isogal.errors import InputError
from isogal.files import write_atomic

CHUNK = 128 * 1024
"""Bytes, uncompressed: about 40 s of the graph at 1 Hz."""
FLUSH_EVERY = 2.0
"""s of wall time after which a chunk is written, however small: what a killed recorder loses."""
SEPARATOR = "=" * 80
BUILTIN = frozenset(
    (
        "bool",
        "byte",
        "char",
        "float32",
        "float64",
        "string",
        "wstring",
        *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)),
    )
)
FOREVER = {"sec": 9223372036, "nsec": 854775807}
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


class _Stream:
    """A file without buffer: what a chunk's write has returned from is in the kernel's hands,
    whatever becomes of this process.

    (Given a raw file, mcap's writer would put a buffer of its own round it.)
    """

    def __init__(self, path: Path) -> None:
        self.file = path.open("wb", buffering=0)

    def write(self, data: bytes) -> int:
        """Write all of it."""
        rest = memoryview(data)
        while rest:
            rest = rest[self.file.write(rest) :]
        return len(data)

    def tell(self) -> int:
        """Return the position."""
        return self.file.tell()

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def close(self) -> None:
        """Bring it to the disk and close it."""
        os.fsync(self.file.fileno())
        self.file.close()


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """No anchors: rosbag2 and people read the file."""

    def ignore_aliases(self, data: Any) -> bool:
        """Repeat equal values."""
        return True


def qos_text(profiles: Sequence[Any]) -> list[dict[str, Any]]:
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


@lru_cache(maxsize=64)
def schema_text(type_name: str) -> str:
    """Return the definition of a message type with all it contains, as the encoding ``ros2msg``
    wants it."""
    parts = [_definition(type_name)]
    seen, queue = {type_name}, _contained(type_name)
    while queue:
        inner = queue.pop(0)
        if inner not in seen:
            seen.add(inner)
            package, _, name = inner.split("/")
            parts.append(f"{SEPARATOR}\nMSG: {package}/{name}\n{_definition(inner)}")
            queue += _contained(inner)
    return "\n".join(parts)


@lru_cache(maxsize=64)
def _definition(type_name: str) -> str:
    package, _, name = type_name.split("/")
    return (_share(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")


def _share(package: str) -> Path:
    """Return a package's share folder; packages from wheels are not in the ament index unless the
    environment names the venv."""
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):
        return Path(sys.prefix) / "share" / package


def _contained(type_name: str) -> list[str]:
    """List the message types that a definition's fields have."""
    package = type_name.split("/", maxsplit=1)[0]
    found = []
    for line in _definition(type_name).splitlines():
        words = line.partition("#")[0].split()
        if len(words) < 2 or "=" in words[1]:
            continue
        base = words[0].partition("[")[0].partition("<")[0]
        if base in BUILTIN:
            continue
        owner, _, name = base.rpartition("/")
        found.append(f"{owner.split('/')[0] or package}/msg/{name}")
    return found


@dataclass
class _Channel:
    id: int
    type: str
    qos: list[dict[str, Any]]
    type_hash: str
    count: int = 0


@dataclass
class BagWriter:
    """Writes one bag.

    Parameters
    ----------
    folder : Path
        Made; must not exist, or hold nothing but an earlier bag where `replace`.
    texts : dict
        Named texts kept in the file ahead of all messages (metadata record ``isogal``).
    replace : bool
        Whether an earlier bag in the folder is deleted.

    Raises
    ------
    InputError
        The folder cannot be used.
    """

    folder: Path
    texts: dict[str, str] = field(default_factory=dict)
    replace: bool = False
    compress: bool = True

    def __post_init__(self) -> None:
        from mcap.writer import CompressionType, Writer

        prepare_folder(self.folder, self.replace)
        self.path = self.folder / f"{self.folder.resolve().name}_0.mcap"
        self.messages = 0
        self._first: int | None = None
        self._last = 0
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._stream = _Stream(self.path)
        compression = CompressionType.ZSTD if self.compress else CompressionType.NONE
        self._writer = Writer(self._stream, chunk_size=CHUNK, compression=compression)
        self._writer.start(profile="ros2", library="isogal")
        if self.texts:
            self._writer.add_metadata("isogal", self.texts)
        self._writer.flush()
        self._flushed = time.monotonic()
        self._write_metadata()

    def add_topic(
        self, topic: str, type_name: str, qos: list[dict[str, Any]], type_hash: str
    ) -> None:
        """Make a topic known; its first message must not come before."""
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(
                type_name, "ros2msg", schema_text(type_name).encode()
            )
        details = {"offered_qos_profiles": _dump(qos), "topic_type_hash": type_hash}
        channel = self._writer.register_channel(topic, "cdr", self._schemas[type_name], details)
        self._channels[topic] = _Channel(channel, type_name, qos, type_hash)

    def knows(self, topic: str) -> bool:
        """Whether the topic was added."""
        return topic in self._channels

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Write one serialised message."""
        channel = self._channels[topic]
        self._writer.add_message(channel.id, log_ns, data, publish_ns, channel.count)
        channel.count += 1
        self.messages += 1
        self._first = log_ns if self._first is None else min(self._first, log_ns)
        self._last = max(self._last, log_ns)

    def flush(self) -> None:
        """Write out what is not on the disk yet, so that a killed recorder loses little; not more
        often than every `FLUSH_EVERY` s."""
        if time.monotonic() - self._flushed >= FLUSH_EVERY:
            self._flushed = time.monotonic()
            self._writer.flush()
            self._write_metadata()

    def close(self) -> None:
        """Finish the file and its metadata."""
        self._writer.add_metadata(
            "rosbag2",
            {"serialized_metadata": _dump(self._information()["rosbag2_bagfile_information"])},
        )
        self._writer.finish()
        self._stream.close()
        self._write_metadata()

    def _information(self) -> dict[str, Any]:
        start = self._first or 0
        span = {
            "duration": {"nanoseconds": max(0, self._last - start)},
            "starting_time": {"nanoseconds_since_epoch": start},
        }
        topics = [
            {
                "topic_metadata": {
                    "name": name,
                    "type": channel.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": channel.qos,
                    "type_description_hash": channel.type_hash,
                },
                "message_count": channel.count,
            }
            for name, channel in self._channels.items()
        ]
        return {
            "rosbag2_bagfile_information": {
                "version": 9,
                "storage_identifier": "mcap",
                **span,
                "message_count": self.messages,
                "topics_with_message_count": topics,
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [self.path.name],
                "files": [{"path": self.path.name, **span, "message_count": self.messages}],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }

    def _write_metadata(self) -> None:
        write_atomic(self.folder / "metadata.yaml", _dump(self._information()))


def prepare_folder(folder: Path, replace: bool) -> None:
    """Make the folder of a new bag; raises InputError where it holds something else, or a bag that
    must stay."""
    if folder.exists():
        if not folder.is_dir():
            raise InputError(f"{folder}: is a file; a bag needs a folder")
        entries = list(folder.iterdir())
        strangers = [
            entry.name
            for entry in entries
            if not (entry.name == "metadata.yaml" or entry.suffix == ".mcap")
        ]
        if strangers:
            raise InputError(
                f"{folder}: holds something else than a bag ({strangers[0]}); give another folder"
            )
        if entries and not replace:
            raise InputError(f"{folder}: there is a bag already; give another folder")
        for entry in entries:
            entry.unlink()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None


def _dump(value: Any) -> str:
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, width=1000)
