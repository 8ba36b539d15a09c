"""Writing recordings as ``ros2 bag record -s mcap`` lays them out: a folder with one MCAP file and
``metadata.yaml``.

The file is written in small chunks, and the scenario goes first: where the recorder is killed, or
the disk is full, the file can be read up to the last whole chunk (`isogal_ros.bags.reader`)."""

import os
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from pydantic import JsonValue

from isogal.errors import InputError
from isogal.files import make_folder, write_atomic
from isogal.mcap_files import parts
from isogal.scenario import Scenario
from isogal_ros.bags.metadata import (
    Entry,
    RecordedTopic,
    earlier_files,
    file_entry,
    information,
    qos_entries,
)
from isogal_ros.messages.prepared import serialised
from isogal_ros.parameters.values import yaml_text
from isogal_ros.topics import LOSSLESS, Message, Topic, type_name

SEPARATOR = "=" * 80


@cache
def schema_text(type_name: str) -> str:
    """Return the definition of a message type (``package/msg/Name``) and of all it contains."""
    names, parts = [type_name], list[str]()
    for one in names:  # which grows
        package, _, name = one.split("/")
        text = (_share(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")
        parts.append(f"{SEPARATOR}\nMSG: {package}/{name}\n{text}" if parts else text)
        kind = getattr(import_module(f"{package}.msg"), name)
        of_fields = " ".join(kind.get_fields_and_field_types().values())
        inner = [f"{owner}/msg/{part}" for owner, part in re.findall(r"(\w+)/(\w+)", of_fields)]
        names += [found for found in dict.fromkeys(inner) if found not in names]
    return "\n".join(parts)


def _share(package: str) -> Path:
    """Return a package's share folder; packages from wheels are not in the ament index unless the
    environment names the venv."""
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):
        return Path(sys.prefix) / "share" / package


CHUNK = 128 * 1024
"""Bytes, uncompressed: about 40 s of the graph at 1 Hz."""
FLUSH_EVERY = 2.0
"""s of wall time after which a chunk is written, however small: what a killed recorder loses."""


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
    compress : bool
        Whether chunks are compressed (zstd).
    resume : bool
        Whether a bag in the folder goes on with a further file, as the parts of a bag that was
        split; `replace` then does not count.

    Raises
    ------
    InputError
        The folder cannot be used.
    """

    folder: Path
    texts: dict[str, str] = field(default_factory=dict)
    replace: bool = False
    compress: bool = True
    resume: bool = False

    def __post_init__(self) -> None:
        from mcap.writer import CompressionType, Writer

        earlier = parts(self.folder) if self.resume else []
        if not earlier:
            prepare_folder(self.folder, self.replace)
        self.path = self.folder / f"{self.folder.resolve().name}_{len(earlier)}.mcap"
        self._earlier = earlier_files(self.folder, earlier)
        self._topics: dict[str, RecordedTopic] = {}
        self._first: int | None = None
        self._last = 0
        """Earliest and latest log time, ns."""
        self.messages = 0
        """Number of messages written."""
        self._schemas: dict[str, int] = {}
        self._failed = False
        self._stream = self.path.open("wb")
        compression = CompressionType.ZSTD if self.compress else CompressionType.NONE
        self._writer = Writer(self._stream, chunk_size=CHUNK, compression=compression)
        self._writer.start(profile="ros2", library="isogal")
        if self.texts:
            self._writer.add_metadata("isogal", self.texts)
        self._write_out()

    def add_topic(self, topic: str, type_name: str, qos: list[JsonValue], type_hash: str) -> None:
        """Make a topic known; its first message must not come before.

        Parameters
        ----------
        topic : str
            Absolute name.
        type_name : str
            ``package/msg/Name``.
        qos : list
            What publishers offer, see `isogal_ros.bags.metadata.qos_entries`.
        type_hash : str
            As publishers say it (``RIHS01_...``); empty = not known.
        """
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(
                type_name, "ros2msg", schema_text(type_name).encode()
            )
        details = {"offered_qos_profiles": yaml_text(qos), "topic_type_hash": type_hash}
        channel = self._writer.register_channel(topic, "cdr", self._schemas[type_name], details)
        self._topics[topic] = RecordedTopic(channel, type_name, qos, type_hash)

    def knows(self, topic: str) -> bool:
        """Whether the topic was added."""
        return topic in self._topics

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Write one serialised message; raises OSError where the disk is full, after which
        nothing more can be written.

        Parameters
        ----------
        topic : str
            Made known by `add_topic`.
        data : bytes
        log_ns, publish_ns : int
            When it was received and sent, ns.
        """
        entry = self._topics[topic]
        self._do(
            lambda: self._writer.add_message(entry.channel, log_ns, data, publish_ns, entry.count)
        )
        entry.count += 1
        self.messages += 1
        self._first = log_ns if self._first is None else min(self._first, log_ns)
        self._last = max(self._last, log_ns)

    def put(self, topic: Topic, message: Message, ns: int) -> None:
        """Write a message of a time (ns) on a topic of the graph, see `write`."""
        name = f"/{topic.name}"
        if not self.knows(name):
            self.add_topic(name, type_name(topic.type), qos_entries([LOSSLESS]), "")
        self.write(name, serialised(message), ns, ns)

    def flush(self) -> None:
        """Write out what is not on the disk yet, so that a killed recorder loses little; not more
        often than every `FLUSH_EVERY` s."""
        if time.monotonic() - self._flushed >= FLUSH_EVERY:
            self._write_out()

    def close(self) -> None:
        """Finish the file and its metadata; one that could not be written to ends where it was
        whole. Raises OSError where that is found only now."""
        if not self._failed:
            self._do(self._finish)

    def _finish(self) -> None:
        text = yaml_text(self._information())
        self._writer.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        self._write_metadata()

    def _information(self) -> Entry:
        this = file_entry(self.path.name, self._first or 0, self._last, self.messages)
        return information([*self._earlier, this], self._topics)

    def _write_out(self) -> None:
        self._flushed = time.monotonic()
        self._do(self._writer.flush)
        self._write_metadata()

    def _do(self, write: Callable[[], None]) -> None:
        """Write something; where that fails, nothing more, since the end of the file is broken."""
        if self._failed:
            raise OSError("an earlier write has failed")
        try:
            write()
        except OSError:
            self._failed = True
            self._stream.raw.close()  # with what the buffer holds
            raise

    def _write_metadata(self) -> None:
        document: Entry = {"rosbag2_bagfile_information": self._information()}
        try:
            write_atomic(self.folder / "metadata.yaml", yaml_text(document))
        except InputError as error:
            self._failed = True
            raise OSError(str(error).rpartition(": ")[2]) from None


def scenario_text(scenario: Scenario) -> str:
    """Return what a bag keeps of its scenario."""
    return yaml.safe_dump(scenario.model_dump(mode="json"), sort_keys=False)


def prepare_folder(folder: Path, replace: bool) -> None:
    """Make the folder of a new bag; raises InputError where it holds something else, or a bag that
    must stay."""
    entries = list(folder.iterdir()) if folder.is_dir() else []
    for entry in entries:
        if entry.name != "metadata.yaml" and entry.suffix != ".mcap":
            raise InputError(
                f"{folder}: holds something else than a bag ({entry.name}); give another folder"
            )
    if entries and not replace:
        raise InputError(f"{folder}: there is a bag already; give another folder")
    for entry in entries:
        entry.unlink()
    make_folder(folder)
