"""The list `fields`: entries are scenarios of one field each, and what cannot be is one line."""

import pytest

from isogal.errors import InputError
from isogal.scenario import validate_scenario

GRAVITY = {"field": "gravity", "sigma": 2e-5, "map_error": {"sigma": 1e-5}}
MAGNETIC = {"field": "magnetic", "sigma": 2.0, "interval": 4.0, "matcher": {"map_sigma": 5.0}}


def of(*entries, **more):
    return validate_scenario({"fields": list(entries), **more})


def test_without_a_list_there_is_one_field_and_a_list_of_one_is_what_the_keys_say():
    alone = validate_scenario(
        {
            "field": "gravity",
            "gravimeter": {"sigma": 2e-5},
            "map_error": {"sigma": 1e-5},
            "matcher": {"batch_length": 15},
        }
    )
    assert alone.each_field == (alone,)
    assert alone.field_names == ("gravity",)
    assert of(GRAVITY, matcher={"batch_length": 15}).each_field == (alone,)


def test_entries_change_single_keys():
    it = of(GRAVITY, MAGNETIC, matcher={"batch_length": 15}, map={"source": "file.nc"})
    gravity, magnetic = it.each_field
    assert (gravity.measured_field, magnetic.measured_field) == ("gravity", "magnetic")
    assert (magnetic.gravimeter.sigma, magnetic.gravimeter.interval) == (2.0, 4.0)
    assert [one.matcher.map_sigma for one in (gravity, magnetic)] == ["auto", 5.0]
    assert [one.matcher.batch_length for one in (gravity, magnetic)] == [15, 15]
    assert [one.map.source for one in (gravity, magnetic)] == ["file.nc", "file.nc"]


def test_streams_of_entries_differ_but_the_first_keeps_the_seed():
    gravity, magnetic = of(GRAVITY, MAGNETIC, seed=7).each_field
    assert gravity.seed == 7
    assert magnetic.seed not in (7, of(GRAVITY, MAGNETIC, seed=8).each_field[1].seed)
    assert of(GRAVITY, MAGNETIC | {"seed": 3}).each_field[1].seed == 3


def test_scans_of_the_run_are_those_that_all_intervals_are_multiples_of():
    it = of(GRAVITY, MAGNETIC)
    assert it.steps_per_scan == 2
    assert [one.steps_per_scan for one in it.each_field] == [10, 4]
    fast = of(GRAVITY, MAGNETIC, imu={"rate": 50.0})
    assert {one.navigation_rate for one in (fast, *fast.each_field)} == {fast.navigation_rate}


def test_truth_is_that_of_the_navigator_or_of_the_entries():
    it = of(
        GRAVITY,
        MAGNETIC | {"truth": {"gravimeter": {"bias": 9.0}}},
        truth={"imu": "3x", "gravimeter": {"sigma": "2x"}},
    )
    assert it.true.imu != it.imu
    for truths in (it.true.each_field, [one.true for one in it.each_field]):
        assert [one.imu for one in truths] == [it.true.imu] * 2
        assert [one.gravimeter.sigma for one in truths] == [4e-5, 4.0]
        assert [one.gravimeter.bias for one in truths] == [0.0, 9.0]
    assert it.true.informed.true == it.true


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ([], "must have an entry for each field"),
        ([GRAVITY, GRAVITY], "two entries are called 'gravity'"),
        ([{"field": "gravty"}], "fields.0.field: unknown field 'gravty'"),
        ([{"sigma": 1e-5}], "fields.0.field: must be given"),
        ([GRAVITY, {"field": "magnetic", "map": {"sorce": "x"}}], "did you mean 'fields.1.map.s"),
        ([{"field": "gravity", "name": "Two words"}], "fields.0.name"),
        ([GRAVITY | {"interval": 0.3}], "whole number of IMU samples"),
        ([GRAVITY | {"matcher": {"mode": "retrodiction"}}], "retrodiction takes one field"),
        (["gravity"], "fields.0: must be a section of keys"),
    ],
)
def test_bad_lists_are_one_line(fields, words):
    with pytest.raises(InputError) as caught:
        of(*fields)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "beside",
    [{"field": "gravity"}, {"gravimeter": {"sigma": 2e-5}}, {"map_error": {"sigma": 1.0}}],
)
def test_keys_in_the_unit_of_a_field_are_said_in_the_entries(beside):
    with pytest.raises(InputError, match="says nothing beside fields"):
        of(GRAVITY, **beside)
