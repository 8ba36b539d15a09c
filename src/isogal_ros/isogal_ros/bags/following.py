"""Reading a recording while it is written: what has been added since the last look."""

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from isogal_ros.bags.collect import Collector
from isogal_ros.bags.parts import parts
from isogal_ros.bags.reader import topic_of
from isogal_ros.topics import Topic

_MAGIC = 8
"""Bytes at the start of an MCAP file."""
_HEAD = struct.Struct("<BQ")
"""Opcode and length of a record (MCAP specification, "Records")."""
_CHUNK, _DATA_END = 0x06, 0x0F


@dataclass
class Follower:
    """Takes the messages of a bag's whole chunks into a collector, each once. A chunk that is
    being written is left for the next look."""

    folder: Path
    collector: Collector
    messages: int = 0
    """Taken so far, of topics that are wanted."""
    _places: dict[Path, int] = field(default_factory=dict)
    _topics: dict[tuple[Path, int], Topic | None] = field(default_factory=dict)

    def look(self) -> int:
        """Take what is new; return how many messages that was."""
        before = self.messages
        for file in parts(self.folder) if self.folder.is_dir() else ():
            for body in self._new_chunks(file):
                self._take(file, body)
        return self.messages - before

    def _new_chunks(self, file: Path) -> Iterator[bytes]:
        """Yield the records, with their heads, of chunks that are whole."""
        place = self._places.get(file, _MAGIC)
        size = file.stat().st_size
        with file.open("rb") as stream:
            while place + _HEAD.size <= size:
                stream.seek(place)
                opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
                if opcode == _DATA_END or place + _HEAD.size + length > size:
                    break
                if opcode == _CHUNK:
                    stream.seek(place)
                    yield stream.read(_HEAD.size + length)
                place += _HEAD.size + length
                self._places[file] = place

    def _take(self, file: Path, record: bytes) -> None:
        from mcap.records import Channel, Message
        from mcap.stream_reader import StreamReader, breakup_chunk

        reader = StreamReader(io.BytesIO(record), skip_magic=True, emit_chunks=True)
        for item in breakup_chunk(next(iter(reader.records)), validate_crc=False):
            if isinstance(item, Channel):
                wanted = self.collector.topics()
                self._topics[file, item.id] = next(
                    (topic for topic in wanted if topic_of(item.topic, topic.name)), None
                )
            elif isinstance(item, Message):
                topic = self._topics.get((file, item.channel_id))
                if topic is not None:
                    self.collector.take(topic, item.data)
                    self.messages += 1
