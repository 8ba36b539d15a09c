"""What the matcher of `isogal match` is told, and what the command says about it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from helpers.command_line import call
from helpers.tracks import field_of, made_track, squared_distance, write_csv
from isogal.cli.map_choice import MapChoice
from isogal.cli.match.inputs import FieldChoice
from isogal.cli.match.options import Assumptions, MatcherChoice, TrackChoice
from isogal.earth.gravity import normal_gravity
from isogal.tracks.fields import TrackField

DISTURBANCE = field_of("disturbance")


def settings_of(assumed=None, matching=None, **of_map):
    """The matcher's settings for a track in mGal."""
    track = replace(made_track(DISTURBANCE)[0], factor=1e-5)
    chosen = TrackChoice(Path("track.csv"))
    choice = FieldChoice("value", MapChoice("map.nc"), chosen, assumed or Assumptions())
    field = TrackField("value", track, replace(DISTURBANCE, **of_map), unit="mGal")
    return choice.settings(matching or MatcherChoice(), field)


def test_keys_of_set_are_in_the_unit_inside_and_options_win():
    keys = ["matcher.map_sigma=4e-5", "matcher.stride=3", "matcher.options.step=300"]
    matching = MatcherChoice("tercom", batch_length="20", stride=5, set_=keys)
    found = settings_of(matching=matching)
    assert (found.name, found.batch_length, found.stride) == ("tercom", 20, 5)
    assert (found.map_sigma, found.options) == (4e-5, {"step": 300})
    assert settings_of(Assumptions(map_sigma="3"), matching).map_sigma == pytest.approx(3e-5)


@pytest.mark.parametrize(
    ("of_map", "set_", "said"),
    [({}, None, True), ({"sigma": 1e-5}, None, False), ({}, ["matcher.map_sigma=0"], False)],
)
def test_a_map_whose_error_is_estimated_is_mentioned(capsys, of_map, set_, said):
    settings_of(matching=MatcherChoice(set_=set_), **of_map)
    assert ("which is estimated" in capsys.readouterr().err) == said


def test_normal_gravity_in_the_offset_may_be_that_of_another_latitude(files, tmp_path):
    """Normal gravity at the navigator's latitude, 700 m off, or at the true one: without
    --reduction the fix is consistent with both."""
    map_file, _, sigma, latitude, longitude = files["disturbance"]
    track, _, _ = made_track(DISTURBANCE, error=(700.0, -500.0), sigma=sigma)
    truth = normal_gravity(latitude, 100.0)
    for reduction, offset in (
        ("latitude", normal_gravity(track.latitude, 100.0)),
        ("none", truth),
    ):
        path = write_csv(
            tmp_path / "track.csv",
            replace(track, value=track.value + truth, offset=offset),
            "time,latitude,longitude,value,offset",
        )
        words = ["match", "--map", map_file, "--track", path, "--sensor-sigma", sigma]
        words += ["--batch-length", 60, "--map-sigma", 0, "--json"]
        for options, warned in (((), True), (("--reduction", reduction), False)):
            _, out, said = call(*words, *options)
            assert ("offset holds normal gravity" in said) == warned
            assert ("an unknown constant of 7.8e-06 m s-2 is allowed for" in said) == warned
            (fix,) = json.loads(out)
            assert squared_distance(fix, latitude[-1], longitude[-1]) < 13.8  # 99.9 %
