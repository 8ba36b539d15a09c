"""Recordings played to fresh nodes."""

from collections import Counter
from pathlib import Path

import pytest

from helpers.node_bench import absolute, topics_of
from helpers.recordings import assert_replayed, assert_replayed_as_run, replayed
from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.viewing import open_bag
from isogal_ros.graph import player as of_bag
from isogal_ros.graph.replay import replay
from isogal_ros.nodes.signals import Interrupt

SAMPLE = Path(__file__).resolve().parents[3] / "bags" / "sample"


def test_a_bag_that_is_cut_off(recording, tmp_path, capsys) -> None:
    data = (recording / "bag_0.mcap").read_bytes()
    (tmp_path / "part.mcap").write_bytes(data[: len(data) // 2])
    result = replayed(tmp_path / "part.mcap")
    (note,) = result.notes
    assert "ends early" in note
    assert "read up to" in note
    assert 60 < result.simulated < 300
    assert result.disagreements == 0
    assert 1 <= result.common < 6
    assert result.largest_difference < 1e-6
    open_bag(tmp_path / "part.mcap")
    assert "part.mcap: not read to its end: the file ends early" in capsys.readouterr().err


def test_it_can_be_interrupted(recording) -> None:
    interrupt = Interrupt()
    interrupt(2)
    result = replay(BagReader(recording), interrupt)
    assert result.interrupted
    assert result.simulated == 0.0


def test_the_sample_is_small_and_whole() -> None:
    assert sum(entry.stat().st_size for entry in SAMPLE.iterdir()) < 3e6
    reader = BagReader(SAMPLE)
    counts = Counter(message.topic for message in reader.messages())
    assert reader.cut is None
    assert set(counts) == {absolute(topic) for topic in topics_of(Scenario())}
    assert counts["/imu/data_raw"] == 1500
    assert counts["/pmht_mm/fix"] == 5


def test_the_sample_replays_to_the_same_fixes() -> None:
    """Within a metre: the last digits are the machine's, but another filter or matcher has to make
    another sample."""
    assert assert_replayed(SAMPLE, 1.0).common >= 3


def thinned(scenario, interval: float) -> Scenario:
    return scenario(
        f"gravimeter.interval={interval}", "matcher.batch_length=3", "matcher.stride=3"
    )


def test_keys_of_the_reduction_reduce_the_readings_anew(recording, scenario) -> None:
    """They were once taken as they had been reduced, without a word."""
    again = thinned(scenario, 20.0)  # every second reading from the first, at 10 s, on
    result = replayed(recording, again)
    assert sorted(result.outputs.fixes) == [10**9 * k for k in range(50, 360, 60)]


def test_other_settings_are_as_if_they_had_been_run(recording, scenario) -> None:
    """Readings that the recorded navigator had reduced were once taken by one that did otherwise:
    with T = 20 instead of 30 a vessel erred 200 m instead of 40."""
    assert_replayed_as_run(recording, scenario("matcher.batch_length=4", "matcher.stride=2"))


def without_the_instrument(monkeypatch) -> None:
    """Let the bag have none of its readings."""
    every = of_bag.wanted_messages
    monkeypatch.setattr(
        of_bag,
        "wanted_messages",
        lambda *wanted: (found for found in every(*wanted) if found[0] is not topics.GRAVIMETRY),
    )


def test_without_readings_of_the_instrument_other_settings_are_told_of(
    recording, scenario, monkeypatch
) -> None:
    without_the_instrument(monkeypatch)
    again = scenario("matcher.batch_length=4", "matcher.stride=2")
    assert "wrong by the Eötvös effect" in replayed(recording, again).notes[-1]


def test_a_reduction_that_the_bag_does_not_allow(recording, scenario, monkeypatch) -> None:
    said = r"cannot make gravimeter.interval shorter than it was \(10 s\)"
    with pytest.raises(InputError, match=said):
        replayed(recording, thinned(scenario, 5.0))
    without_the_instrument(monkeypatch)
    with pytest.raises(InputError, match=r"a replay cannot change gravimeter\.interval"):
        replayed(recording, thinned(scenario, 20.0))
