"""Figures and report of a matched track, with and without fixes."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.tracks import field_of, made_track
from isogal.evaluation.figures import style
from isogal.matching.interfaces import declined
from isogal.scenario import Matcher
from isogal.tracks.fields import TrackField
from isogal.tracks.figures import track_map_figure
from isogal.tracks.match_report import write_match_report
from isogal.tracks.matching import Uncertainty, match_fields, match_track

HEIGHT = field_of("height")
PRIOR = Uncertainty(position=800.0)


TOLD = Matcher(map_sigma=0.0, bias_sigma=0.0, options={"trust": 1.0})
"""Of all that may be wrong nothing: one model, which is quick."""


@pytest.mark.parametrize("step", [(200.0, 0.0), (140.0, -170.0)])
def test_map_shows_the_track_and_its_fixes(step):
    track, _, _ = made_track(HEIGHT, error=(500.0, -400.0), sigma=5.0, step=step)
    matches = match_track(track, HEIGHT, TOLD, PRIOR)
    figure = track_map_figure(track, HEIGHT, matches)
    panel = figure.axes[0]
    for place, (low, high) in (
        (track.longitude, panel.get_xlim()),
        (track.latitude, panel.get_ylim()),
    ):
        assert low < np.degrees(place).min() <= np.degrees(place).max() < high
    (dots,) = [line for line in panel.lines if line.get_marker() == "o"]
    assert len(dots.get_xdata()) == sum(match.fix.published for match in matches) > 0


class Decliner:
    """A matcher that never gives a fix."""

    name = "declines"
    context = 0

    def match(self, batch, field_map, memory):
        return declined(batch, "it is < & >"), None


@pytest.mark.parametrize("matcher", [None, Decliner()], ids=["fixes", "none"])
def test_report_has_figures_and_reasons(tmp_path, monkeypatch, matcher):
    monkeypatch.setattr(style, "png", lambda _: b"not drawn")
    track, _, _ = made_track(HEIGHT, error=(500.0, -400.0), sigma=5.0)
    holed = replace(track, value=np.where(np.arange(60) % 7 == 0, np.nan, track.value))
    field = TrackField("height", holed, HEIGHT, unit="m")
    matches = match_fields([field], PRIOR, matcher=matcher)
    page = write_match_report([field], PRIOR, matches, tmp_path)
    text = page.read_text()
    figures = {"track.png", "readings.png"} | ({"shifts.png"} if matcher is None else set())
    assert text.count("data:image/png") == len(figures)
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", *figures}
    assert f"{sum(m.fix.published for m in matches)} fixes of 2 batches" in text
    assert ("it is &lt; &amp; &gt;" in text) == (matcher is not None)
