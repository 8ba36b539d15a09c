"""What a fault passes with, and what it fails with."""

import pytest

from isogal_ros.faults.campaign import page_of, table_of, two_batches
from isogal_ros.faults.catalogue import Fault

GOOD = {
    "fault": "x", "trial": 0, "crash": None, "not_finite": 0, "unexpected_errors": [],
    "reported_after": 5.0, "report": "filter: no samples", "error_during": 90.0,
    "error_after": 50.0, "error_without": 50.0, "lost": 3,
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "passes"),
    [
        ({}, True),
        ({"crash": "the process ended"}, False),
        ({"not_finite": 1}, False),
        ({"unexpected_errors": ["KeyError"]}, False),
        ({"reported_after": None, "report": None}, False),
        ({"reported_after": 1e6}, False),
        ({"error_after": 94.0}, True),  # 1.3 times as large, and 30 m
        ({"error_after": 96.0}, False),
        ({"error_after": None}, False),
    ],
)
def test_a_fault_passes_that_is_reported_and_recovered_from(scenario, change, passes) -> None:
    table = table_of(scenario(), [Fault("x", ("imu",), "stopped")], [GOOD | change])
    assert table["failed"] == ([] if passes else ["x"])
    assert ("**no**" in page_of(table)) == (not passes)


def test_what_need_not_be_reported_passes_without(scenario) -> None:
    small = Fault("x", ("imu",), "stopped", matters=False)
    silent = GOOD | {"reported_after": None, "report": None}
    assert table_of(scenario(), [small], [silent])["failed"] == []


def test_late_by_two_batches_of_all_trials_counts_once(scenario) -> None:
    limit = two_batches(scenario())
    trials = [GOOD | {"reported_after": after} for after in (1.0, limit, limit + 1.0)]
    (row,) = table_of(scenario(), [Fault("x", ("imu",), "stopped")], trials)["faults"]
    assert (row["reported"], row["reported_after_s"]) == (3, limit)
    assert row["failures"] == ["1 x not reported in time"]
