"""Reading recordings, whole or cut off, message by message."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from isogal.errors import InputError
from isogal.mcap_damage import is_damage, unpacked
from isogal.scenario import Scenario, validate_scenario
from isogal.yaml_text import parse_yaml
from isogal_ros.bags.compressed import opened
from isogal_ros.bags.parts import SUFFIXES, numbered, parts


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message as recorded."""

    topic: str
    data: bytes
    """Serialised."""
    log_ns: int
    publish_ns: int = 0


@dataclass
class BagReader:
    """A bag: a folder as ``ros2 bag`` makes it, or one MCAP file.

    Raises
    ------
    InputError
        There is no such bag, it is of another storage format, or not of MCAP.
    """

    path: Path
    texts: dict[str, str] = field(default_factory=dict)
    """What the recorder kept beside the messages; filled while reading."""
    cut: str | None = None
    """Why the reading ended early; None = the file is whole. Known after reading."""
    types: dict[str, str] = field(default_factory=dict)
    """Message type by topic; filled while reading."""

    def __post_init__(self) -> None:
        self.path = Path(self.path)
        self.files = _find_files(self.path)
        self._read_texts()

    def scenario(self) -> Scenario | None:
        """Return the scenario of the recorded run; None where the bag has none. Raises InputError
        where it is damaged."""
        if "scenario" not in self.texts:
            return None
        where = f"{self.path}: scenario"
        return validate_scenario(parse_yaml(self.texts["scenario"], where), where)

    def messages(self) -> Iterator[Recorded]:
        """Yield the messages in the order they were written, up to the end or the cut; of a bag
        in several files each up to its own."""
        for file in self.files:
            self.cut = None
            yield from self._messages_of(file)

    def _messages_of(self, file: Path) -> Iterator[Recorded]:
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader

        channels: dict[int, str] = {}
        schemas: dict[int, str] = {}
        with opened(file) as stream, self._up_to_damage(file, stream):
            for record in StreamReader(stream, emit_chunks=True).records:
                for item in unpacked(record):
                    if isinstance(item, Schema):
                        schemas[item.id] = item.name
                    elif isinstance(item, Channel):
                        channels[item.id] = item.topic
                        self.types[item.topic] = schemas.get(item.schema_id, "")
                    elif isinstance(item, Message):
                        yield Recorded(
                            channels[item.channel_id], item.data, item.log_time, item.publish_time
                        )

    def _read_texts(self) -> None:
        """Read what stands ahead of the messages."""
        from mcap.records import Chunk, Message, Metadata
        from mcap.stream_reader import StreamReader

        file = self.files[0]
        with opened(file) as stream, self._up_to_damage(file, stream):
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Metadata) and record.name == "isogal":
                    self.texts.update(record.metadata)
                if self.texts or isinstance(record, Chunk | Message):
                    return

    @contextmanager
    def _up_to_damage(self, file: Path, stream: BinaryIO) -> Iterator[None]:
        """End the reading where the file is cut off or damaged, and say so in `cut`; raises
        InputError where it is no MCAP file."""
        from mcap.exceptions import EndOfFile, InvalidMagic

        try:
            yield
        except Exception as error:
            if not is_damage(error):
                raise
            place = stream.tell()
            if _is_empty(stream) or (isinstance(error, InvalidMagic) and not self.types):
                raise InputError(f"{file}: not an MCAP file") from None
            kind = type(error).__name__
            if isinstance(error, EndOfFile | struct.error):
                self.cut = f"the file ends early, at byte {file.stat().st_size} ({kind})"
            else:
                self.cut = f"the file is damaged ahead of byte {place} ({kind})"


def _is_empty(stream: BinaryIO) -> bool:
    stream.seek(0, 2)
    return stream.tell() < 8


def _find_files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: no such bag")
    if path.is_file():
        if not path.name.endswith(SUFFIXES):
            raise InputError(
                f"{path}: not an MCAP file by its name; a bag is a folder, or a file that ends in"
                " .mcap or .mcap.zstd"
            )
        return [path]
    files = parts(path)
    if not files:
        others = sorted(entry.name for entry in path.glob("*.db3"))
        hint = (
            f" but {others[0]}; convert it: ros2 bag convert with storage_id mcap"
            if others
            else ""
        )
        raise InputError(f"{path}: no MCAP file in this folder{hint}")
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
