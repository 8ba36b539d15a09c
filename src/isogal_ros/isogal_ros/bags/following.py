"""Reading a recording while it is written: what has been added since the last look."""

import struct
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from isogal.mcap_damage import unpacked
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.parts import parts
from isogal_ros.bags.reader import topic_of
from isogal_ros.topics import Topic


@dataclass
class Follower:
    """Takes the messages of a bag's whole chunks into a collector, each once. A chunk that is
    being written is left for the next look."""

    folder: Path
    collector: Collector
    messages: int = 0
    """Taken so far, of topics that are wanted."""
    _places: dict[Path, int] = field(default_factory=dict)
    """Bytes of each file that were read."""
    _topics: dict[tuple[Path, int], Topic | None] = field(default_factory=dict)

    def look(self) -> int:
        """Take what is new; return how many messages that was."""
        before = self.messages
        for file in parts(self.folder):
            self._read_on(file)
        return self.messages - before

    def _read_on(self, file: Path) -> None:
        from mcap.exceptions import EndOfFile, InvalidMagic
        from mcap.stream_reader import StreamReader

        place = self._places.get(file, 0)
        # what is not whole yet is read again from its begin
        with file.open("rb") as stream, suppress(EndOfFile, InvalidMagic, struct.error):
            stream.seek(place)
            reader = StreamReader(stream, skip_magic=place > 0, emit_chunks=True)
            for record in reader.records:
                for item in unpacked(record):
                    self._take(file, item)
                self._places[file] = stream.tell()

    def _take(self, file: Path, item: Any) -> None:
        from mcap.records import Channel, Message

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
