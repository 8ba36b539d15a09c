"""Bags are read whole or up to a cut, and what is no bag is refused."""

import struct

import pytest
import yaml
import zstandard

from helpers.bag_writing import write
from isogal.errors import InputError
from isogal.mcap_files import parts
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.writer import BagWriter


def cut_off(data: bytes, share: float) -> bytes:
    return data[: int(len(data) * share)]


def spoilt(data: bytes, share: float) -> bytes:
    begin = int(len(data) * share)
    return data[:begin] + bytes(64) + data[begin + 64 :]


@pytest.mark.parametrize(
    ("damage", "share"),
    [(cut_off, 0.02), (cut_off, 0.5), (cut_off, 0.999), (spoilt, 0.5)],
)
def test_a_damaged_file_is_read_up_to_the_damage(tmp_path, damage, share) -> None:
    messages = write(tmp_path / "bag", 4000)
    path = tmp_path / "bag" / "bag_0.mcap"
    path.write_bytes(damage(path.read_bytes(), share))
    reader = BagReader(tmp_path / "bag")
    found = [item.data for item in reader.messages()]
    assert found == messages[: len(found)]
    assert len(found) >= share * 4000 - 800  # a chunk at most, and what lies behind the messages
    assert reader.cut
    assert ("ends early" if damage is cut_off else "damaged") in str(reader.cut)
    assert damage is cut_off or len(found) < 4000
    assert reader.scenario().seed == 3


CHUNK_OPCODE = 6


def _place_of_chunk(data: bytes) -> int:
    """Where the first chunk's record begins."""
    place = 8
    while data[place] != CHUNK_OPCODE:
        place += 9 + struct.unpack_from("<Q", data, place + 1)[0]
    return place


@pytest.mark.parametrize(
    ("field", "value", "largest"),
    [
        # of a chunk: times 8 + 8, its size unpacked 8, checksum 4, "zstd" 4 + 4, size 8
        (16, 2**64 - 1, None),
        (36, 2**64 - 1, None),
        (16, 1, 10_000),  # the frame says that it is more than may be unpacked
    ],
)
def test_a_size_that_cannot_be_is_damage(tmp_path, monkeypatch, field, value, largest) -> None:
    if largest is not None:
        monkeypatch.setattr("isogal.mcap_files.LARGEST_CHUNK", largest)
    write(tmp_path / "bag")
    path = tmp_path / "bag" / "bag_0.mcap"
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, _place_of_chunk(data) + 9 + field, value)
    path.write_bytes(data)
    reader = BagReader(tmp_path / "bag")
    assert list(reader.messages()) == []
    assert "the file is damaged ahead of byte" in str(reader.cut)


def test_a_scenario_that_is_no_yaml_is_refused_in_one_line(tmp_path) -> None:
    write(tmp_path / "bag")
    path = tmp_path / "bag" / "bag_0.mcap"
    data = path.read_bytes()
    assert data.count(b"seed: 3") == 1
    path.write_bytes(data.replace(b"seed: 3", b"seed: \x00"))
    with pytest.raises(InputError, match="bag: scenario: not valid YAML: special") as caught:
        BagReader(tmp_path / "bag").scenario()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("files", "path", "words"),
    [
        ({}, "none", "no such bag"),
        ({}, "", "no MCAP file"),
        ({"x.py": b""}, "x.py", "no MCAP file"),
        ({"x.db3": b""}, "", r"ros2 bag convert.*rosbags-convert"),
        ({"x.db3": b""}, "x.db3", r"ros2 bag convert.*rosbags-convert"),
        ({"y.mcap": b"123"}, "y.mcap", "not an MCAP file"),
        ({"y.mcap": b"hello, this is no MCAP file at all"}, "y.mcap", "not an MCAP file"),
        ({"y.mcap": b"", "z.mcap": b""}, "", "2 MCAP files"),
        ({"y.mcap.zstd": b"not zstd at all"}, "y.mcap.zstd", "not compressed by zstd"),
    ],
)
def test_bad_bags(tmp_path, files, path, words) -> None:
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words):
        BagReader(tmp_path / path)


def again(folder, count: int, first: int) -> None:
    """A recorder that was started again writes on."""
    made = BagWriter(folder, {"run": "0"}, resume=True)
    made.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu", [], "")
    for i in range(first, first + count):
        made.write("/imu/data_raw", bytes(20), i * 10**9, i)
    made.close()


@pytest.mark.parametrize("metadata", [None, "", "files: []"], ids=["whole", "empty", "another"])
def test_a_recorder_that_was_started_again_keeps_what_there_was(tmp_path, metadata) -> None:
    bag = tmp_path / "bag"
    write(bag, 50)
    whole = (bag / "bag_0.mcap").read_bytes()
    (bag / "bag_0.mcap").write_bytes(whole[: len(whole) // 2])  # killed
    if metadata is not None:
        (bag / "metadata.yaml").write_text(metadata)
    kept = sum(1 for _ in BagReader(bag).messages())
    again(bag, 30, 60)
    assert [file.name for file in parts(bag)] == ["bag_0.mcap", "bag_1.mcap"]
    reader = BagReader(bag)
    assert sum(1 for _ in reader.messages()) == kept + 30
    assert reader.cut is None
    document = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert document["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]
    assert document["message_count"] == sum(file["message_count"] for file in document["files"])


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
    packed.write_bytes(zstandard.compress(bytes(10**7)))
    monkeypatch.setattr("isogal.mcap_files.LARGEST", 10**6)
    with pytest.raises(InputError, match="more than 1000000 bytes"):
        BagReader(packed)
