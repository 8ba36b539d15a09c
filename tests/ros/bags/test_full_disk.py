"""A disk that is full while a bag is recorded."""

import errno
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader

from helpers.node_bench import bench
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags import writer as writer_module
from isogal_ros.bags.metadata import qos_entries
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.bags.writer import CHUNK, BagWriter
from isogal_ros.nodes.health import ERROR, WARN

ROOM = 3 * CHUNK


def whole(bag: Path) -> int:
    """Number of messages of a bag that is not cut off, as metadata.yaml says, too."""
    reader = BagReader(bag)
    count = sum(1 for _ in reader.messages())
    assert reader.cut is None
    with (bag / "bag_0.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == count
    document = yaml.safe_load((bag / "metadata.yaml").read_text())
    assert document["rosbag2_bagfile_information"]["message_count"] == count
    return count


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

    def truncate(self, size: int) -> None:
        self.room += self.file.tell() - size
        self.file.truncate(size)

    def __getattr__(self, name: str):
        return getattr(self.file, name)


@pytest.fixture
def disk(tmp_path) -> Iterator[Path]:
    """A disk of half a megabyte."""
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", str(folder)]
    try:
        subprocess.run(words, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no small disk can be mounted here")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.fixture
def small_disk(monkeypatch) -> None:
    make = writer_module._Stream.__init__

    def on_it(self, path) -> None:
        make(self, path)
        self.file = Disk(self.file)

    monkeypatch.setattr(writer_module._Stream, "__init__", on_it)


def test_the_recorder_ends_and_says_so(small_disk, scenario, tmp_path) -> None:
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag"), compress=False) as made:
        message = topics.IMU.type()
        for k in range(3000):
            message.header.stamp.sec = k
            made.publish(topics.IMU, message)
        made.wait(lambda: made.node.finished, "the recorder's end")
        assert made.node.exit_code == 1
        assert "cannot be written: No space left on device" in made.node.failure
        assert made.says()[-1][0] == ERROR
        made.node.close()
    assert whole(tmp_path / "bag") > 500


def test_a_real_disk_that_is_full(disk, scenario) -> None:
    """Where metadata.yaml finds no room either, none of the messages could be read."""
    with bench(RECORDER, scenario(), bag=str(disk / "bag"), compress=False) as made:
        made.wait(lambda: made.says() and made.says()[-1][0] == WARN)
        assert "GB left (disk_warning: 1 GB)" in made.says()[-1][1]
        publisher, message = made.publisher(topics.IMU), topics.IMU.type()
        count = 0
        while not made.node.finished:
            count += 1
            assert count < 20_000
            message.header.stamp.sec = count
            publisher.publish(message)
            made.bus.run()
        made.node.close()
        assert made.node.exit_code == 1
    assert 500 < whole(disk / "bag") <= count
    complaints = [line for line in made.bus.errors if "cannot be" in line]
    assert len(complaints) == 1
    assert "No space left on device; the recording ends here, and can be read" in complaints[0]


def test_a_disk_that_is_full_from_the_start_is_one_line(disk, scenario) -> None:
    with (disk / "other").open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))
    with (
        pytest.raises(InputError, match="cannot be written: No space left on device"),
        bench(RECORDER, scenario(), bag=str(disk / "bag")),
    ):
        pass


@pytest.mark.parametrize("room", range(0, 350_000, 23_337))
def test_wherever_the_disk_ends_the_bag_is_whole(small_disk, monkeypatch, tmp_path, room) -> None:
    monkeypatch.setattr(f"{__name__}.ROOM", 2000 + room)
    writer = BagWriter(tmp_path / "bag", {"scenario": "seed: 3"}, compress=False)
    writer.add_topic("/nav/fix", "sensor_msgs/msg/NavSatFix", qos_entries([topics.LOSSLESS]), "")
    try:
        for k in range(1500):
            writer.write("/nav/fix", bytes(200), k, k)
    except OSError:
        with pytest.raises(OSError, match="earlier write"):
            for k in range(1500):
                writer.write("/nav/fix", bytes(200), k, k)
        writer.close()
    else:
        with pytest.raises(OSError, match="No space"):
            writer.close()
    assert whole(tmp_path / "bag") == writer.messages
    assert BagReader(tmp_path / "bag").scenario() is not None
