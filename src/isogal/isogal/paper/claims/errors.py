"""Claims about errors and divergence by noise, batch length and map (paper, sections 4.1, 4.2.1
fifth, 4.2.2 and 4.2.3)."""

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.cases import DEFAULT, Setting
from isogal.paper.claims import reasons
from isogal.paper.claims.statistics import paired, rate_interval
from isogal.paper.claims.verdicts import FAILS, HOUR, OPEN, Decision, claim, decide
from isogal.paper.measure import Outcome
from isogal.paper.published import HIGH, LOW, ROWS, TABLE_4
from isogal.paper.results import Results


def _trend(pairs: list[tuple[Outcome, Outcome]], names: list[str]) -> Decision:
    """Decide whether the first of each pair errs more than the second."""
    scores = [paired(a, b) for a, b in pairs]
    text = "; ".join(
        f"{name}: {number(a.mean)} m against {number(b.mean)} m"
        for name, (a, b) in zip(names, pairs, strict=True)
    )
    return text + ".", decide(min(scores) > 2.0, min(scores) < -2.0)


@claim(
    "sensor",
    "section 4.2.1, fifth; discussion, third",
    "The error depends on the precision of the field sensor.",
    why=reasons.overconfident,
)
def _sensor(results: Results) -> Decision:
    cases = [(quantity, length) for quantity in LOW for length in (30, 15)]
    pairs = [
        (results.at(q, HIGH[q], length), results.at(q, LOW[q], length)) for q, length in cases
    ]
    return _trend(pairs, [f"{q}, T = {length}, high against low noise" for q, length in cases])


@claim("resolution", "section 4.2.1, fifth", "The error depends on the resolution of the map.")
def _resolution(results: Results) -> Decision:
    cells = [
        results.plan.field_map(Setting(quantity=quantity)).cell_size_m(-0.64) for quantity in LOW
    ]
    text = (
        f"Both maps have the same cells here ({cells[0][0]:.0f} m and {cells[1][0]:.0f} m"
        " north-south), so nothing was compared."
    )
    return text, OPEN


@claim(
    "500 m",
    "section 4.2.2",
    "With gravity at 1e-5 m/s² the mean error is somewhat above 500 m.",
    why=reasons.method,
)
def _five_hundred(results: Results) -> Decision:
    outcomes = [results.row(row) for row in TABLE_4[:2]]
    text = "; ".join(
        f"T = {o.setting.batch_length}: {number(o.mean)} ± {number(o.mean_uncertainty, 2)} m "
        f"({DEFAULT}: {number(results.row(row, DEFAULT).mean)} m)"
        for o, row in zip(outcomes, TABLE_4[:2], strict=True)
    )
    low = [o.mean - 2 * o.mean_uncertainty for o in outcomes]
    high = [o.mean + 2 * o.mean_uncertainty for o in outcomes]
    return text + ".", decide(
        min(high) > 500.0 and max(low) < 600.0, max(high) < 500.0 or min(low) > 600.0
    )


@claim(
    "divergence by noise",
    "section 4.2.2",
    "Runs diverge more often when the sensor is noisier.",
    why=reasons.windows,
)
def _divergence_by_noise(results: Results) -> Decision:
    parts, higher, lower = [], [], []
    for row in (row for row in ROWS if row.sigma == HIGH[row.quantity]):
        quantity, length = row.quantity, row.batch_length
        noisy, quiet = results.row(row), results.at(quantity, LOW[quantity], length)
        runs = len(noisy.run_means)
        parts.append(f"{quantity}, T = {length}: {quiet.diverged} and {noisy.diverged} of {runs}")
        least, most = rate_interval(noisy.diverged, runs)
        higher.append(least > rate_interval(quiet.diverged, runs)[1])
        lower.append(most < row.divergence_rate)
    return "; ".join(parts) + " (low and high noise).", decide(any(higher), all(lower))


@claim(
    "T and noise",
    "section 4.2.2",
    "The two noise levels differ more with T = 15 than with T = 30.",
    why=reasons.windows,
)
def _batch_and_noise(results: Results) -> Decision:
    parts, scores = [], []
    for quantity in LOW:
        steps = {
            length: (
                results.at(quantity, HIGH[quantity], length).run_means
                - results.at(quantity, LOW[quantity], length).run_means
            )
            for length in (15, 30)
        }
        parts.append(
            f"{quantity}: {number(float(steps[15].mean()))} m with T = 15,"
            f" {number(float(steps[30].mean()))} m with T = 30"
        )
        difference = steps[15] - steps[30]
        spread = (
            difference.std(ddof=1) / np.sqrt(len(difference)) if len(difference) > 1 else np.inf
        )
        scores.append(float(difference.mean() / max(spread, 1e-12)))
    return "; ".join(parts) + ".", decide(
        min(scores) > 2.0, max(scores) < 2.0 and min(scores) < -2.0
    )


@claim(
    "shorter batches",
    "section 4.1",
    "Short batches (T = 15) err and diverge more than long ones (T = 30).",
    why=reasons.windows,
)
def _shorter(results: Results) -> Decision:
    cases = [(row.quantity, row.sigma) for row in ROWS if row.batch_length == 30]
    pairs = [(results.at(q, s, 15), results.at(q, s, 30)) for q, s in cases]
    text, verdict = _trend(pairs, [f"{q}, {s:g} m/s²: T = 15 against 30" for q, s in cases])
    counts = [sum(o.diverged for o in side) for side in zip(*pairs, strict=True)]
    return f"{text[:-1]}; diverged runs in all: {counts[0]} against {counts[1]}.", verdict


@claim(
    "no divergence",
    "section 4.2.2",
    "With gravity at low noise no run diverges, with T = 15 as with T = 30.",
    why=reasons.overconfident,
)
def _no_divergence(results: Results) -> Decision:
    counts = [results.row(row).diverged for row in TABLE_4[:2]]
    runs = results.plan.runs
    text = f"T = 30: {counts[0]} of {runs}, T = 15: {counts[1]} of {runs}."
    return text, decide(
        counts == [0, 0] and runs >= 30, rate_interval(max(counts), runs)[0] > 0.01
    )


@claim(
    "maps alike",
    "section 4.2.3",
    "The disturbance map gives no significantly different errors than the gravity map.",
    why=reasons.overconfident,
)
def _maps_alike(results: Results) -> Decision:
    cases = [(level, length) for level in (LOW, HIGH) for length in (30, 15)]
    ratios = [
        results.at("disturbance", level["disturbance"], n).mean
        / results.at("gravity", level["gravity"], n).mean
        for level, n in cases
    ]
    text = "Mean error with disturbance over that with gravity: " + ", ".join(
        f"{number(ratio)} ({'low' if level is LOW else 'high'} noise, T = {n})"
        for ratio, (level, n) in zip(ratios, cases, strict=True)
    )
    return text + ".", decide(
        min(ratios) > 0.67 and max(ratios) < 1.5, min(ratios) < 0.5 or max(ratios) > 2.0
    )


@claim(
    "first hour",
    "section 4.2.3",
    "The error is overwhelmingly large in the first hour, because the map varies little there.",
)
def _first_hour(results: Results) -> Decision:
    outcome, signal = (
        results.at("disturbance", LOW["disturbance"], 30),
        results.signal["disturbance"],
    )
    end = float(outcome.time[-1])
    if end < 2 * HOUR:
        return "The runs are too short.", OPEN
    first, later = outcome.rms_between(0.0, HOUR), outcome.rms_between(HOUR, end)
    early = signal.time <= HOUR
    varies = float(np.nanmean(signal.variability[early]) / np.nanmean(signal.variability[~early]))
    text = (
        f"{number(first)} m RMS in the first hour, {number(later)} m after it; "
        f"the variability there is {number(varies)} times that of the rest."
    )
    if varies > 0.8:
        return (
            text + " On this map the first hour does not vary less.",
            OPEN if first > later else FAILS,
        )
    return text, decide(first > 1.5 * later, first < 1.1 * later)


RULES = (
    _sensor,
    _resolution,
    _five_hundred,
    _divergence_by_noise,
    _batch_and_noise,
    _shorter,
    _no_divergence,
    _maps_alike,
    _first_hour,
)
"""In the paper's order."""
