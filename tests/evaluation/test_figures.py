"""Figures: what they show, and whether they are legible in grey."""

import io
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from helpers.route_maps import made_up as field
from helpers.studies import outcomes
from isogal.evaluation.figures import style
from isogal.evaluation.figures.errors import (
    ensemble_figure,
    error_figure,
    nees_figure,
    stanford_figure,
)
from isogal.evaluation.figures.signal import signal_figure
from isogal.evaluation.figures.track import track_figure
from isogal.scenario import Integrity


def declining(runs):
    count = runs.fix_time.size
    reasons = [["flat" if b % 3 == 0 else "" for b in range(count)]] * len(runs)
    error, covariance = runs.fix_error.copy(), runs.fix_covariance.copy()
    error[:, ::3], covariance[:, ::3] = np.nan, np.nan
    return replace(runs, **outcomes(reasons), fix_error=error, fix_covariance=covariance)


def all_figures(runs):
    figures = {
        "track": track_figure(runs, field()),
        "errors": error_figure(runs),
        "nees": nees_figure(runs),
        "stanford": stanford_figure(runs, Integrity(alert_limit=400.0)),
        "ensemble": ensemble_figure(runs, np.full(runs.time.size, 30.0)),
    }
    if runs.detail is not None:
        figures["signal"] = signal_figure(runs, field(), 2e-5)
    return figures


def test_axes_name_their_units_and_legends_their_curves_and_nothing_is_cut_off(make_runs):
    for name, figure in all_figures(declining(make_runs(runs=1, detail=True))).items():
        axes = [text for one in figure.axes for text in (one.get_xlabel(), one.get_ylabel())]
        assert any(axes), name
        assert all(text.rstrip().endswith(")") for text in axes if text), (name, axes)
        legends = figure.findobj(mpl.legend.Legend)
        named = {text.get_text() for legend in legends for text in legend.get_texts()}
        drawn = {label for panel in figure.axes for label in panel.get_legend_handles_labels()[1]}
        assert drawn == named, name
        picture = np.asarray(Image.open(io.BytesIO(style.png(figure))).convert("L"))
        assert picture.shape[1] == round(style.WIDTH * style.DPI), name
        for edge in (picture[0], picture[-1], picture[:, 0], picture[:, -1]):
            assert edge.min() == 255, name


@pytest.mark.parametrize(
    "changes",
    [
        {"runs": 1, "batches": 0},
        {
            "runs": 4,
            "detail": True,
            "fix_error": np.full((4, 24, 2), np.nan),
            "fix_covariance": np.full((4, 24, 2, 2), np.nan),
            **outcomes([["flat"] * 24] * 4),
        },
    ],
    ids=["no batch", "nothing is published"],
)
def test_odd_records_are_drawn_without_complaint(make_runs, changes, monkeypatch):
    monkeypatch.setattr(style, "DPI", 50)
    with np.errstate(all="raise"):
        for figure in all_figures(make_runs(**changes)).values():
            assert len(style.png(figure)) > 1000


def test_scales_of_fields():
    gravity = style.field_scale(field())
    np.testing.assert_allclose(gravity([9.8, 9.8 + 2e-5]), [0.0, 2.0], atol=1e-6)
    assert "9.80 m/s²" in gravity.name
    assert style.field_scale(field(quantity="disturbance", level=0.0))([3e-5]) == pytest.approx(
        3.0
    )
    magnetic = style.field_scale(field("nT", "magnetic_anomaly", 0.0))
    assert magnetic([40.0]) == 40.0 and magnetic.two_lines == "Magnetic anomaly\n(nT)"


def test_errors_are_those_of_the_record(make_runs):
    runs = make_runs(runs=5)
    panel, north = ensemble_figure(runs, 30.0 * np.ones(121)).axes[0], error_figure(runs).axes[0]
    drawn, of_first = ({x.get_label(): x.get_ydata() for x in it.lines} for it in (panel, north))
    np.testing.assert_allclose(drawn["aided"], np.sqrt((runs.error**2).sum(-1).mean(0)))
    unaided = np.sqrt((runs.unaided_error**2).sum(-1).mean(0))
    np.testing.assert_allclose(drawn["unaided INS"], unaided)
    np.testing.assert_allclose(drawn["posterior Cramér–Rao bound (RMS)"], 30.0)
    np.testing.assert_allclose(panel.lines[0].get_xdata(), runs.time / 3600.0)
    np.testing.assert_allclose(of_first["aided"], runs.error[0, :, 0])
    np.testing.assert_allclose(of_first["unaided INS"], runs.unaided_error[0, :, 0])
    assert north.collections[0].get_paths()[0].vertices[:, 1].max() == pytest.approx(150.0)
