"""Figures of a matched track."""

import numpy as np
import pytest

from helpers.tracks import field_of, made_track
from isogal.scenario import Matcher
from isogal.tracks.figures import readings_figure, track_map_figure
from isogal.tracks.matching import Uncertainty, match_track

HEIGHT = field_of("height")
PRIOR = Uncertainty(position=800.0)


def told(**keys) -> Matcher:
    """Of all that may be wrong nothing: one model, which is quick."""
    return Matcher(map_sigma=0.0, bias_sigma=0.0, options={"trust": 1.0}, **keys)


@pytest.mark.parametrize("step", [(200.0, 0.0), (0.0, 200.0), (140.0, -170.0)])
def test_map_shows_the_track_and_its_fixes(step):
    track, _, _ = made_track(HEIGHT, error=(500.0, -400.0), sigma=5.0, step=step)
    matches = match_track(track, HEIGHT, told(batch_length=20), PRIOR)
    figure = track_map_figure(track, HEIGHT, matches)
    panel = figure.axes[0]
    for place, (low, high) in (
        (track.longitude, panel.get_xlim()),
        (track.latitude, panel.get_ylim()),
    ):
        assert low < np.degrees(place).min() <= np.degrees(place).max() < high
    (dots,) = [line for line in panel.lines if line.get_marker() == "o"]
    assert len(dots.get_xdata()) == sum(match.fix.published for match in matches) > 0
    labels = {label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]}
    tracks = {"track as recorded", "track moved by the fixes"}
    assert labels == tracks | {r"fix with its $2\sigma$ ellipse"}


def test_readings_agree_with_the_map_along_the_matched_track():
    track, _, _ = made_track(HEIGHT, error=(500.0, -400.0), sigma=5.0)
    figure = readings_figure(track, HEIGHT, match_track(track, HEIGHT, told(), PRIOR))
    recorded, matched = (line.get_ydata() for line in figure.axes[1].lines[:2])
    assert np.std(matched) < 10.0 < 5.0 * np.std(recorded)
    assert figure.axes[0].get_ylabel() == "Height\n(m)"
