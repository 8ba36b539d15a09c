"""Recordings: laid out as ros2 bag does, readable by others, kept when the recorder is killed."""

import errno
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from helpers.bag_writing import begin, sample, write
from helpers.node_bench import bench
from isogal.errors import InputError
from isogal.files import write_atomic
from isogal_ros import topics
from isogal_ros.bags import recorder
from isogal_ros.bags import writer as writer_module
from isogal_ros.bags.metadata import qos_entries
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.bags.writer import CHUNK, BagWriter, prepare_folder
from isogal_ros.nodes.health import ERROR, WARN


def test_others_read_it(tmp_path) -> None:
    """By metadata.yaml as rosbag2 writes it, version 9, without aliases, which it cannot read."""
    write(tmp_path / "bag", 50)
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "&id" not in text
    assert yaml.safe_load(text)["rosbag2_bagfile_information"]["version"] == 9
    with AnyReader([tmp_path / "bag"]) as reader:
        (connection,) = reader.connections
        found = connection.topic, connection.msgtype, connection.msgcount
        assert found == ("/imu/data_raw", "sensor_msgs/msg/Imu", 50)
        (qos,) = connection.ext.offered_qos_profiles
        assert (qos.history.name, qos.reliability.name) == ("KEEP_ALL", "RELIABLE")
        assert (qos.deadline.sec, qos.deadline.nsec) == (9223372036, 854775807)
        assert (reader.message_count, reader.start_time) == (50, 0)
        assert reader.duration in (49 * 10**9, 49 * 10**9 + 1)  # to the last, or after it
        values = [
            reader.deserialize(data, kind.msgtype).linear_acceleration.x
            for kind, _, data in reader.messages()
        ]
    assert values == [i * 0.1 for i in range(50)]


def test_a_killed_writer_leaves_what_it_has_flushed(tmp_path, monkeypatch) -> None:
    """What other processes see of its file is what is there when it is gone."""
    monkeypatch.setattr(writer_module, "FLUSH_EVERY", 0.0)
    folder = tmp_path / "bag"
    writer = begin(folder)
    for i in range(1000):
        writer.write("/imu/data_raw", sample(i), i * 10**9, i)
        if i % 100 == 99:
            writer.flush()
    reader = BagReader(folder)
    assert len(list(reader.messages())) == 1000
    assert reader.cut
    metadata = yaml.safe_load((folder / "metadata.yaml").read_text())
    assert metadata["rosbag2_bagfile_information"]["version"] == 9
    writer.close()


def test_folders(tmp_path) -> None:
    prepare_folder(tmp_path / "a" / "b", replace=False)
    assert (tmp_path / "a" / "b").is_dir()
    write(tmp_path / "bag", 5)
    with pytest.raises(InputError, match="there is a bag already"):
        prepare_folder(tmp_path / "bag", replace=False)
    prepare_folder(tmp_path / "bag", replace=True)
    assert not list((tmp_path / "bag").iterdir())
    (tmp_path / "bag" / "notes.txt").write_text("not a bag")
    with pytest.raises(InputError, match=r"something else than a bag \(notes.txt\)"):
        prepare_folder(tmp_path / "bag", replace=True)
    assert (tmp_path / "bag" / "notes.txt").exists()
    with pytest.raises(InputError, match="is a file"):
        prepare_folder(tmp_path / "bag" / "notes.txt", replace=True)


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
    """Stands for a file on a disk with room for some bytes, and for the disk."""

    room = ROOM

    def __init__(self, file) -> None:
        self.file = file

    def write(self, data) -> int:
        if Disk.room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = self.file.write(data[: Disk.room])
        Disk.room -= taken
        return taken

    def truncate(self, size: int) -> None:
        Disk.room += self.file.tell() - size
        self.file.truncate(size)

    def __getattr__(self, name: str):
        return getattr(self.file, name)

    @staticmethod
    def write_atomic(path: Path, text: str) -> None:
        if Disk.room < len(text):
            raise InputError(f"{path}: cannot be written: No space left on device")
        write_atomic(path, text)


@pytest.fixture
def small_disk(monkeypatch):
    """Let bags be written to a disk with some room."""
    make = writer_module._Stream.__init__

    def on_it(self, path) -> None:
        make(self, path)
        self.file = Disk(self.file)

    monkeypatch.setattr(writer_module._Stream, "__init__", on_it)
    monkeypatch.setattr(writer_module, "write_atomic", Disk.write_atomic)
    monkeypatch.setattr(recorder.shutil, "disk_usage", lambda _: SimpleNamespace(free=5e8))
    return lambda room: monkeypatch.setattr(Disk, "room", room)


def test_the_recorder_ends_and_says_so(small_disk, scenario, tmp_path) -> None:
    small_disk(ROOM)
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag"), compress=False) as made:
        made.wait(lambda: made.says() and made.says()[-1][0] == WARN)
        assert "GB left (disk_warning: 1 GB)" in made.says()[-1][1]
        message = topics.IMU.type()
        for k in range(3000):
            message.header.stamp.sec = k
            made.publish(topics.IMU, message)
        made.wait(lambda: made.node.finished, "the recorder's end")
        assert made.node.exit_code == 1
        assert made.says()[-1][0] == ERROR
        made.node.close()
    assert whole(tmp_path / "bag") > 500
    (complaint,) = [line for line in made.bus.errors if "cannot be" in line]
    assert "No space left on device; the recording ends here, and can be read" in complaint


def test_a_disk_that_is_full_from_the_start_is_one_line(small_disk, scenario, tmp_path) -> None:
    small_disk(0)
    with (
        pytest.raises(InputError, match="cannot be written: No space left on device"),
        bench(RECORDER, scenario(), bag=str(tmp_path / "bag")),
    ):
        pass


@pytest.mark.parametrize("room", range(0, 350_000, 49_999))
def test_wherever_the_disk_ends_the_bag_is_whole(small_disk, tmp_path, room) -> None:
    small_disk(2000 + room)
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
