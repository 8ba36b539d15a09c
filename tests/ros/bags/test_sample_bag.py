"""The recording that comes with the repository."""

from collections import Counter
from pathlib import Path

import pytest

from helpers.node_bench import topics_of
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.replay import replay
from isogal_ros.nodes.spin import Interrupt

pytestmark = pytest.mark.ros
SAMPLE = Path(__file__).resolve().parents[3] / "bags" / "sample"


def test_it_is_small_and_whole() -> None:
    assert sum(entry.stat().st_size for entry in SAMPLE.iterdir()) < 3e6
    reader = BagReader(SAMPLE)
    counts = Counter(message.topic for message in reader.messages())
    assert reader.cut is None
    assert set(counts) == {"/" + topic.name.lstrip("/") for topic in topics_of("gravity")}
    assert counts["/imu/data_raw"] == 1500
    assert counts["/pmht_mm/fix"] == 5


def test_it_replays_to_the_same_fixes() -> None:
    """Within a metre: the last digits are the machine's, but another filter or matcher has to make
    another sample."""
    result = replay(BagReader(SAMPLE), Interrupt(), lambda *_: None)
    assert result.notes == []
    assert result.comparison.recorded == result.comparison.replayed == result.comparison.common
    assert result.comparison.recorded >= 3
    assert result.comparison.disagreements == 0
    assert result.comparison.largest_difference < 1.0
