"""Stamps are whole nanoseconds."""

from isogal_ros.messages.stamps import among, from_seconds, to_seconds

TODAY = 1_764_187_200_123_456_789


def test_times_in_seconds_are_the_stamps_that_they_were_made_of() -> None:
    stamps = [TODAY + k * 20_000_001 for k in range(100)]
    seconds = [to_seconds(ns) for ns in stamps]
    assert among(reversed(seconds), stamps) == stamps[::-1]
    assert [from_seconds(time) for time in seconds] != stamps  # a float64 is coarser
    assert among([0.25, 2.0], [2_000_000_000]) == [250_000_000, 2_000_000_000]
