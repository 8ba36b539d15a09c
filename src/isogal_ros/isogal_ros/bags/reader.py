"""Reading recordings, whole or cut off, message by message."""

import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from isogal.errors import InputError
from isogal.mcap_files import SUFFIXES, is_damage, numbered, opened, parts, records_of
from isogal.scenario import Scenario, validate_scenario
from isogal.yaml_text import parse_yaml
from isogal_ros.bags.remapping import Remapping, given_drivers
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.drivers import Entrance
from isogal_ros.messages.mounting import TF_STATIC, Link, Tree, placed, read_transforms

if TYPE_CHECKING:
    from mcap.records import McapRecord

SQLITE = (".db3", ".db3.zstd")
_CONVERT = (
    "a SQLite recording of rosbag2: convert it by `ros2 bag convert` with storage_id mcap, or"
    " without ROS by `rosbags-convert --src FOLDER --dst NEW --dst-storage mcap`"
    " (Python package rosbags)"
)


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as recorded."""

    topic: str
    data: bytes
    """Serialised."""
    log_ns: int


@dataclass
class BagReader:
    """A bag: a folder as ``ros2 bag`` makes it, or one MCAP file.

    Raises
    ------
    InputError
        There is no such bag, it is of another storage format, or not of MCAP; or a rule is wrong.
    """

    path: Path
    remap: Sequence[str] = ()
    """Rules ``FROM:=TO``: how topics are called instead (`Remapping`)."""
    drivers: Sequence[str] = ()
    """How messages of sensors come where the recording does not say it: ``TOPIC.KEY=VALUE``."""
    texts: dict[str, str] = field(default_factory=dict)
    """What the recorder kept besides the messages."""
    cut: str | None = None
    """Why the reading ended early; None = the file is whole. Known after reading."""
    types: dict[str, str] = field(default_factory=dict)
    """Message type by topic; filled while reading."""
    _places: dict[Path, int] = field(default_factory=dict)
    """Bytes of each file that were read."""
    _channels: dict[tuple[Path, int], str | None] = field(default_factory=dict)
    """Topic by number; None = it is left out."""

    def __post_init__(self) -> None:
        from mcap.records import Header, Metadata

        self.path, self._remapping = Path(self.path), Remapping.parse(self.remap)
        self.files = _find_files(self.path)
        for record in self._records(self.files[0]):
            if isinstance(record, Metadata) and record.name == "isogal":
                self.texts.update(record.metadata)
            if not isinstance(record, Header | Metadata):  # the texts stand ahead of all else
                break
        said = Entrance.of(
            self.texts.get("entrance", Entrance().text()), given_drivers(self.drivers)
        )
        self.entrance = placed(said, lambda _: self._static_transforms())
        self._places.clear()

    def _static_transforms(self) -> Tree:
        found: dict[str, Link] = {}
        for message in self.messages():
            if topic_of(message.topic, TF_STATIC):
                with suppress(BadMessageError):
                    found |= read_transforms(message.data)
        return found

    def scenario(self) -> Scenario | None:
        """Return the scenario of the recorded run; None where the bag has none. Raises InputError
        where it is damaged."""
        if "scenario" not in self.texts:
            return None
        where = f"{self.path}: scenario"
        return validate_scenario(parse_yaml(self.texts["scenario"], where), where)

    def messages(self) -> Iterator[Recorded]:
        """Yield the messages in the order they were written, up to the end or the cut; of a bag
        in several files each up to its own. Raises InputError where a topic that is renamed is not
        there."""
        self._places.clear()
        yield from self.new_messages()
        self._remapping.check(self.path)

    def new_messages(self) -> Iterator[Recorded]:
        """Yield the messages that have come since the last one that was read, of a bag that is
        being written; those of a chunk that is not whole yet come next time."""
        from mcap.records import Channel, Message, Schema

        for file in parts(self.path) or self.files:
            self.cut = None
            schemas: dict[int, str] = {}
            for item in self._records(file):
                if isinstance(item, Schema):
                    schemas[item.id] = item.name
                elif isinstance(item, Channel):
                    topic = self._channels[file, item.id] = self._remapping(item.topic)
                    if topic is not None:
                        self.types[topic] = schemas.get(item.schema_id, "")
                elif isinstance(item, Message):
                    topic = self._channels[file, item.channel_id]
                    if topic is not None:
                        yield Recorded(topic, item.data, item.log_time)

    def _records(self, file: Path) -> "Iterator[McapRecord]":
        """Yield the records of a file and of its chunks. Where it is cut off or damaged, end, and
        say so in `cut`; raises InputError where it is no MCAP file."""
        from mcap.exceptions import EndOfFile, InvalidMagic

        with opened(file) as stream:
            try:
                for place, records in records_of(stream, self._places.get(file, 0)):
                    yield from records
                    self._places[file] = place
            except Exception as error:
                if not is_damage(error):
                    raise
                place, size = stream.tell(), stream.seek(0, 2)
                if size < 8 or (isinstance(error, InvalidMagic) and not self.types):
                    raise InputError(f"{file}: not an MCAP file") from None
                if isinstance(error, EndOfFile | struct.error):
                    self.cut = f"the file ends early, at byte {file.stat().st_size}"
                else:
                    self.cut = f"the file is damaged ahead of byte {place}"


def _find_files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: no such bag")
    files = [path] if path.is_file() and path.name.endswith(SUFFIXES) else parts(path)
    if not files:
        entries = path.iterdir() if path.is_dir() else [path]
        how = f"; {_CONVERT}" if any(one.name.endswith(SQLITE) for one in entries) else ""
        raise InputError(
            f"{path}: no MCAP file; a bag is a folder with files that end in .mcap or .mcap.zstd,"
            f" or one of these{how}"
        )
    if len(files) > 1 and not numbered(files):
        raise InputError(
            f"{path}: {len(files)} MCAP files that are not parts of one bag; give one of them:"
            f" {', '.join(file.name for file in files[:3])}"
        )
    return files


def topic_of(recorded: str, name: str) -> bool:
    """Whether a recorded (absolute) topic is the graph's topic of that name, in whatever
    namespace."""
    return recorded == name or recorded.endswith("/" + name.lstrip("/"))
