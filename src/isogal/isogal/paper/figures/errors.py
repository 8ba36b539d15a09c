"""RMS errors over time, by noise and batch length, by way of aiding, by setting (paper figs. 52,
56, 56b, 61, 61a, and beyond)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.consistency import chi_square_interval
from isogal.evaluation.figures import style
from isogal.evaluation.figures.ensemble import Curve, rms_figure
from isogal.paper.cases import DEFAULT, MATCHERS, PAPER, SWEEP_HEADINGS, SWEEP_SPEEDS, Setting
from isogal.paper.measure import Outcome
from isogal.paper.published import HIGH, LOW
from isogal.paper.results import Results
from isogal.scenario.imu_grades import PAPER_GRADES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GRADE_LABELS = {"precision": "PCAG", "quantum_accelerometer": "QAPCG", "quantum": "quantum"}
_LINES = {PAPER: style.Line(style.PURPLE, (0, (5, 1.5, 1, 1.5)), 1.5), DEFAULT: style.AIDED}


def overview_figure(results: Results) -> "Figure":
    """RMS errors of the unaided INS by grade and of the aided one by map (fig-52)."""
    unaided = [
        style.Line(style.VERMILION, "-", 2.6),
        style.Line(style.BLACK, (0, (4, 3)), 1.4),
        style.Line(style.ORANGE, (0, (1, 2)), 2.0),
    ]
    curves = [
        Curve(f"unaided, {GRADE_LABELS[grade]}", o.time, o.unaided_rms, line)
        for line, (grade, o) in zip(
            unaided, ((g, results.unaided(g)) for g in PAPER_GRADES), strict=True
        )
    ]
    lines = {
        (PAPER, "gravity"): style.Line(style.PURPLE, "-", 1.5),
        (PAPER, "disturbance"): style.Line(style.PURPLE, (0, (3, 1.2)), 1.3),
        (DEFAULT, "gravity"): style.Line(style.BLUE, "-", 1.5),
        (DEFAULT, "disturbance"): style.Line(style.BLUE, (0, (3, 1.2)), 1.3),
    }
    for (matcher, quantity), line in lines.items():
        outcome = results.at(quantity, LOW[quantity], 30, matcher)
        curves.append(Curve(f"{matcher}, {quantity}", outcome.time, outcome.rms, line))
    return rms_figure(curves)


@style.journal
def noise_figure(results: Results, quantity: str, batch_length: int) -> "Figure":
    """RMS errors at both noise levels for one map and batch length (figs. 56, 56b, 61, 61a), with
    the bound."""
    figure = style.new_figure(3.3)
    panels = figure.subplots(1, 2, sharey=True)
    for panel, sigma in zip(panels, (LOW[quantity], HIGH[quantity]), strict=True):
        outcomes = {
            matcher: results.at(quantity, sigma, batch_length, matcher) for matcher in MATCHERS
        }
        paper = outcomes[PAPER]
        _curve(panel, paper, paper.unaided_rms, style.UNAIDED, "unaided INS")
        for matcher, outcome in outcomes.items():
            _curve(panel, outcome, outcome.rms, _LINES[matcher], matcher)
        _curve(panel, paper, paper.bound, style.BOUND, "posterior Cramér–Rao bound")
        panel.set_yscale("log")
        panel.grid(True, which="minor", axis="y", linewidth=0.25)
        panel.set_title(rf"$\sigma$ = {sigma:g} m/s², T = {batch_length}", loc="left")
        style.time_axis(panel, float(style.hours(paper.time[-1:])[0]))
    panels[0].set_ylabel("RMS position error (m)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _curve(panel: "Axes", outcome: Outcome, values: Array, line: style.Line, label: str) -> None:
    panel.plot(style.hours(outcome.time), values, **line.options(), label=label)


@style.journal
def retrodiction_figure(results: Results) -> "Figure":
    """Standard aiding and retrodiction: RMS errors of all runs, and the track of one run over half
    an hour."""
    figure = style.new_figure(3.4)
    left, right = figure.subplots(1, 2)
    standard, late = Setting(), Setting(mode="retrodiction")
    lines = {standard: _LINES[PAPER], late: style.Line(style.GREEN, (0, (4, 1.5)), 1.5)}
    names = {standard: "standard", late: "retrodiction, as output"}
    for setting, line in lines.items():
        outcome = results.outcomes[setting]
        _curve(left, outcome, outcome.rms, line, names[setting])
        tracks = results.tracks[setting]
        right.plot(
            tracks.time / 60.0, np.hypot(*tracks.live[0].T), **line.options(), label=names[setting]
        )
    left.set_ylim(bottom=0.0)
    left.set_ylabel("RMS position error (m)")
    left.set_title("all runs", loc="left")
    style.time_axis(left, float(style.hours(outcome.time[-1:])[0]))
    tracks = results.tracks[late]
    revised = style.Line(style.BLACK, "-", 1.3)
    right.plot(
        tracks.time / 60.0,
        np.hypot(*tracks.revised[0].T),
        **revised.options(),
        label="retrodiction, revised",
    )
    middle = tracks.time[-1] / 120.0
    half = min(30.0, middle)
    inside = np.abs(tracks.time / 60.0 - middle) <= half
    top = max(
        np.hypot(*t[0, inside].T).max()
        for t in (results.tracks[standard].live, tracks.live, tracks.revised)
    )
    right.set_xlim(middle - half, middle + half)
    right.set_ylim(0.0, style.nice_limit(float(top)))
    right.set_xlabel("time since start (min)")
    right.set_ylabel("position error (m)")
    right.set_title("one run", loc="left")
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@style.journal
def spread_figure(results: Results) -> "Figure":
    """RMS error of the unaided INS, each grade, and what its filter claims, with the chi-square
    interval."""
    figure = style.new_figure(2.9)
    panels = figure.subplots(1, len(results.spreads), sharey=True)
    for panel, spread in zip(panels, results.spreads, strict=True):
        outcome = results.unaided(spread.grade)
        _curve(
            panel,
            outcome,
            outcome.unaided_rms,
            style.UNAIDED,
            f"RMS of {len(outcome.run_means)} runs",
        )
        low, high = np.sqrt(chi_square_interval(len(outcome.run_means), 2))
        panel.errorbar(
            style.hours(spread.time),
            spread.claimed,
            spread.claimed * np.array([[1.0 - low], [high - 1.0]]),
            fmt="s",
            color=style.BLACK,
            markersize=3.5,
            capsize=2.5,
            elinewidth=0.9,
            label="filter's covariance, 95 % of such RMS",
        )
        panel.set_title(GRADE_LABELS[spread.grade], loc="left")
        style.time_axis(panel, float(style.hours(outcome.time[-1:])[0]))
        panel.set_ylim(bottom=0.0)
    panels[0].set_ylabel("horizontal error (m)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@style.journal
def sensitivity_figure(results: Results) -> "Figure":
    """Errors against what the paper does not state: initial heading error and speed."""
    figure = style.new_figure(3.1)
    left, right = figure.subplots(1, 2, sharey=True)
    for panel, name, values in ((left, "heading", SWEEP_HEADINGS), (right, "speed", SWEEP_SPEEDS)):
        changes: list[dict[str, Any]] = [{name: value} for value in values]
        panel.plot(
            values,
            [_rms(results.outcomes[Setting(**change)].unaided) for change in changes],
            **style.UNAIDED.options(),
            marker="^",
            markersize=4.5,
            label="unaided INS",
        )
        for matcher, marker in zip(MATCHERS, "Do", strict=True):
            outcomes = [results.outcomes[Setting(matcher=matcher, **change)] for change in changes]
            panel.plot(
                values,
                [_rms(outcome.error) for outcome in outcomes],
                **_LINES[matcher].options(),
                marker=marker,
                markersize=4.5,
                label=matcher,
            )
        panel.set_yscale("log")
        panel.grid(True, which="minor", axis="y", linewidth=0.25)
    left.set_xscale("log")
    left.set_xlabel("initial heading error, 1-sigma (rad)")
    left.set_ylabel("RMS position error (m)")
    right.set_xlabel("speed (m/s)")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))
