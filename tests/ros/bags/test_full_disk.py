"""A disk that is full while a bag is recorded."""

import errno

import pytest

from helpers.node_bench import bench
from isogal_ros import topics
from isogal_ros.bags import writer as writer_module
from isogal_ros.bags.metadata import qos_entries
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.bags.writer import CHUNK, BagWriter
from isogal_ros.nodes.health import ERROR

ROOM = 3 * CHUNK


class Disk:
    """Stands for a file on a disk with room for some bytes."""

    def __init__(self, file) -> None:
        self.file, self.room = file, ROOM

    def write(self, data) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = self.file.write(data[: self.room])
        self.room -= taken
        return taken

    def __getattr__(self, name: str):
        return getattr(self.file, name)


@pytest.fixture
def small_disk(monkeypatch) -> None:
    make = writer_module._Stream.__init__

    def on_it(self, path) -> None:
        make(self, path)
        self.file = Disk(self.file)

    monkeypatch.setattr(writer_module._Stream, "__init__", on_it)


def test_what_was_written_can_be_read(small_disk, tmp_path) -> None:
    writer = BagWriter(tmp_path / "bag", {"scenario": "seed: 3"}, compress=False)
    writer.add_topic("/nav/fix", "sensor_msgs/msg/NavSatFix", qos_entries([topics.LOSSLESS]), "")
    with pytest.raises(OSError, match="No space left"):
        for k in range(10_000):
            writer.write("/nav/fix", bytes(200), k, k)
    with pytest.raises(OSError, match="earlier write"):
        for k in range(10_000):
            writer.write("/nav/fix", bytes(200), k, k)
    writer.close()
    reader = BagReader(tmp_path / "bag")
    assert 1000 < sum(1 for _ in reader.messages()) < 2000
    assert reader.cut is not None
    assert reader.scenario() is not None


def test_the_recorder_ends_and_says_so(small_disk, scenario, tmp_path) -> None:
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag"), compress=False) as made:
        publisher = made.publisher(topics.IMU)
        message = topics.IMU.type()
        for k in range(3000):
            message.header.stamp.sec = k
            publisher.publish(message)
        made.wait(lambda: made.node.finished, "the recorder's end")
        made.settle()
        assert made.node.exit_code == 1
        assert "cannot be written: No space left on device" in made.node.failure
        assert made.says()[-1][0] == ERROR
        made.node.writer.close()
    assert sum(1 for _ in BagReader(tmp_path / "bag").messages()) > 500
