"""Bags of several files, and files that are compressed as a whole."""

import pytest
import yaml
import zstandard
from rosbags.highlevel import AnyReader

from helpers.bag_writing import write
from isogal.errors import InputError
from isogal_ros.bags import reader as reader_module
from isogal_ros.bags.reader import BagReader, numbered, parts
from isogal_ros.bags.writer import BagWriter


def again(folder, count: int, first: int) -> None:
    """A recorder that was started again writes on."""
    made = BagWriter(folder, {"run": "0"}, resume=True)
    made.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu", [], "")
    for i in range(first, first + count):
        made.write("/imu/data_raw", bytes(20), i * 10**9, i)
    made.close()


def test_a_recorder_that_was_started_again_keeps_what_there_was(tmp_path) -> None:
    bag = tmp_path / "bag"
    write(bag, 50)
    whole = (bag / "bag_0.mcap").read_bytes()
    (bag / "bag_0.mcap").write_bytes(whole[: len(whole) // 2])  # killed
    kept = sum(1 for _ in BagReader(bag).messages())
    again(bag, 30, 60)
    assert [file.name for file in parts(bag)] == ["bag_0.mcap", "bag_1.mcap"]
    reader = BagReader(bag)
    assert sum(1 for _ in reader.messages()) == kept + 30
    assert reader.cut is None
    document = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert document["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]
    assert document["message_count"] == sum(file["message_count"] for file in document["files"])


def test_others_read_all_parts(tmp_path) -> None:
    bag = tmp_path / "bag"
    again(bag, 10, 0)
    again(bag, 20, 10)
    with AnyReader([bag]) as reader:
        assert sum(1 for _ in reader.messages()) == 30


def test_the_order_is_that_of_the_numbers(tmp_path) -> None:
    for i in (10, 2, 0, 1):
        (tmp_path / f"a_{i}.mcap").touch()
    files = parts(tmp_path)
    assert [file.name for file in files] == ["a_0.mcap", "a_1.mcap", "a_2.mcap", "a_10.mcap"]
    assert numbered(files[:3])
    assert not numbered(files)


def test_a_compressed_file(tmp_path, monkeypatch) -> None:
    write(tmp_path / "bag", 40)
    plain = tmp_path / "bag" / "bag_0.mcap"
    packed = tmp_path / "bag_0.mcap.zstd"
    packed.write_bytes(zstandard.compress(plain.read_bytes()))
    reader, expected = BagReader(packed), BagReader(plain)
    assert list(reader.messages()) == list(expected.messages())
    assert reader.texts == expected.texts
    packed.write_bytes(packed.read_bytes()[:-200])  # its only block
    with pytest.raises(InputError, match="not an MCAP file"):
        BagReader(packed)
    packed.write_bytes(b"not zstd at all")
    with pytest.raises(InputError, match="not compressed by zstd"):
        BagReader(packed)
    packed.write_bytes(zstandard.compress(bytes(10**7)))
    monkeypatch.setattr(reader_module, "LARGEST", 10**6)
    with pytest.raises(InputError, match="more than 1000000 bytes"):
        BagReader(packed)
