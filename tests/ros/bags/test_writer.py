"""Recordings: laid out as ros2 bag does, readable by others, kept when the recorder is killed."""

import errno
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
import yaml
from rosbags.highlevel import AnyReader

from helpers.bag_writing import begin, sample, write
from helpers.node_bench import bench
from isogal.errors import InputError
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


@contextmanager
def room(size: int) -> Iterator[None]:
    """Let no file grow beyond a size (bytes), as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_the_recorder_ends_and_says_so(scenario, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(recorder.shutil, "disk_usage", lambda _: SimpleNamespace(free=5e8))
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag"), compress=False) as made:
        made.wait(lambda: made.says() and made.says()[-1][0] == WARN)
        assert "GB left (disk_warning: 1 GB)" in made.says()[-1][1]
        message = topics.IMU.type()
        with room(3 * CHUNK):
            for k in range(3000):
                message.header.stamp.sec = k
                made.publish(topics.IMU, message)
        assert (made.node.finished, made.node.exit_code) == (True, 1)
        assert made.says()[-1][0] == ERROR
        made.node.close()
    assert sum(1 for _ in BagReader(tmp_path / "bag").messages()) > 500
    (complaint,) = [line for line in made.bus.errors if "cannot be" in line]
    assert "File too large; the recording ends here, and can be read" in complaint


def test_a_disk_that_is_full_from_the_start_is_one_line(scenario, tmp_path, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(BagWriter, "_do", full)
    with (
        pytest.raises(InputError, match="cannot be written: No space left on device"),
        bench(RECORDER, scenario(), bag=str(tmp_path / "bag")),
    ):
        pass


@pytest.mark.parametrize("size", range(2500, 300_000, 74_000))
def test_wherever_the_disk_ends_the_bag_can_be_read(tmp_path, size) -> None:
    writer = BagWriter(tmp_path / "bag", {"scenario": "seed: 3"}, compress=False)
    writer.add_topic("/nav/fix", "sensor_msgs/msg/NavSatFix", qos_entries([topics.LOSSLESS]), "")

    def write_all() -> None:
        for k in range(1500):
            writer.write("/nav/fix", bytes(200), k, k)
        writer.close()

    with room(size), pytest.raises(OSError, match="File too large"):
        write_all()
    with pytest.raises(OSError, match="an earlier write"):
        write_all()
    writer.close()
    reader = BagReader(tmp_path / "bag")
    assert sum(1 for _ in reader.messages()) * 250 > size - 1.1 * CHUNK
    assert "ends early" in reader.cut
    assert reader.scenario() is not None
