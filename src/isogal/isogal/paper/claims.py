"""The paper's claims, each decided from what was measured here: holds, does not, or cannot be
told.

Means of the same runs are compared in pairs (the same random numbers), and a difference counts
from two of its standard errors. Shares of diverged runs are compared by their exact binomial 95 %
intervals. The paper's claims are about the paper's matcher, and so are the verdicts."""

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper import reasons
from isogal.paper.cases import DEFAULT, PAPER, RIVAL, Setting
from isogal.paper.measure import Outcome, roughness
from isogal.paper.published import BENEFIT_TIME, GAIN_TIME, HIGH, LOW, QUANTUM_GAIN, ROWS, TABLE_4
from isogal.paper.results import Results
from isogal.paper.verdicts import (
    FAILS,
    HOLDS,
    HOUR,
    OPEN,
    REGISTER,
    Claim,
    Decision,
    after,
    benefit_time,
    claim,
    decide,
    metres,
    paired,
    quantum_gain,
    rate_interval,
)


def judge(results: Results) -> tuple[Claim, ...]:
    """Decide all claims, in the paper's order."""
    claims = []
    for entry in REGISTER:
        measured, verdict = entry.decide(results)
        why = entry.why(results) if entry.why is not None and verdict != HOLDS else ""
        claims.append(Claim(entry.key, entry.source, entry.text, measured, verdict, why))
    return tuple(claims)


@claim("ambiguity", "section 2", "One reading may match more than one place in the search window.")
def _ambiguity(results: Results) -> Decision:
    share = results.profile.ambiguous
    text = (
        f"Along a line to the east it does at {100 * share:.0f} % of the places along the track"
        " (window of 8 km)."
    )
    return text, decide(share > 0.1, share < 0.01)


@claim(
    "iterations",
    "section 3.2",
    "After 15 iterations, hardly any difference between two iterations is left.",
    why=reasons.ambiguous,
)
def _iterations(results: Results) -> Decision:
    last = (
        np.median([snapshot.movement[-1] for snapshot in results.snapshots])
        if results.snapshots
        else np.nan
    )
    most = (
        np.median([snapshot.movement.max() for snapshot in results.snapshots])
        if results.snapshots
        else np.nan
    )
    text = (
        f"The 15th iteration moves the batch by {metres(float(last))} (median of"
        f" {len(results.snapshots)} batches), the largest step is {metres(float(most))}."
    )
    return text, decide(last < 0.05 * most, last > 0.1 * most)


@claim("retrodiction", "section 3.3", "The estimated trajectory is smoother with retrodiction.")
def _retrodiction(results: Results) -> Decision:
    parts, ratios = [], []
    for setting, tracks in results.tracks.items():
        if setting.mode == "retrodiction":
            standard = results.tracks[Setting(batch_length=setting.batch_length)]
            a, b, c = roughness(standard.live), roughness(tracks.live), roughness(tracks.revised)
            parts.append(
                f"T = {setting.batch_length}: the error changes by {metres(a)} RMS from scan to"
                f" scan with standard aiding, by {metres(c)} in the track that retrodiction leaves"
                f" behind (as output at the time: {metres(b)})"
            )
            ratios.append(c / a)
    return "; ".join(parts) + ".", decide(max(ratios) < 0.8, min(ratios) > 1.0)


@claim(
    "variability",
    "section 3.3",
    "The map feature variability reflects how much the data vary along the track.",
)
def _variability(results: Results) -> Decision:
    from scipy.stats import spearmanr

    signal = results.signal["disturbance"]
    window = 30
    if len(signal.signal) < 4 * window:
        return "The runs are too short.", OPEN
    parts = np.lib.stride_tricks.sliding_window_view(signal.signal, window)
    correlation = float(
        spearmanr(parts.std(axis=1), signal.variability[window // 2 :][: len(parts)]).statistic
    )
    text = (
        f"Rank correlation of the variability with the standard deviation of {window} readings"
        f" around: {number(correlation, 2)}."
    )
    return text, decide(correlation > 0.4, correlation < 0.2)


@claim(
    "unbounded",
    "section 4.2.1, first",
    "Without aiding the RMS error grows without bound, even with high-end sensors.",
)
def _unbounded(results: Results) -> Decision:
    outcome = results.unaided("precision")
    end = float(outcome.time[-1])
    quarters = [
        float(np.interp(f * end, outcome.time, outcome.unaided_rms))
        for f in (0.25, 0.5, 0.75, 1.0)
    ]
    text = (
        f"Precision grade: {', '.join(number(q) for q in quarters)} m after each quarter of"
        f" {end / HOUR:.1f} h."
    )
    if end < 2 * HOUR:
        return text, OPEN
    return text, decide(quarters[3] > 1.2 * quarters[1], quarters[3] < 1.05 * quarters[1])


@claim(
    "quantum gain",
    "section 4.2.1, second",
    "Quantum accelerometers reduce the RMS error after 3.5 h by a little over 6 %.",
    why=reasons.accelerometers,
)
def _quantum_gain(results: Results) -> Decision:
    gain, error = quantum_gain(results)
    theory = {heading: 1 - results.drift[heading, "quantum_accelerometer"] / results.drift[heading, "precision"]
              for heading, grade in results.drift if grade == "precision"}  # fmt: skip
    text = f"{100 * gain:.2f} % (2 standard errors: {200 * error:.2f} %); by theory " + ", ".join(
        f"{100 * value:.2f} % with {heading:g} rad of heading error"
        for heading, value in theory.items()
    )
    if results.plan.gain_time < GAIN_TIME:
        return text + ".", OPEN
    near = abs(gain - QUANTUM_GAIN) < max(2 * error, 0.01)
    return text + ".", decide(near and 2 * error < 0.02, not near)


@claim(
    "quantum drift",
    "section 4.2.1, second",
    "With quantum accelerometers the drift is still unbounded.",
)
def _quantum_drift(results: Results) -> Decision:
    outcome = results.unaided("quantum_accelerometer")
    end = float(outcome.time[-1])
    half, whole = (
        float(np.interp(f * end, outcome.time, outcome.unaided_rms)) for f in (0.5, 1.0)
    )
    text = (
        f"{metres(half)} RMS after {end / HOUR / 2:.1f} h, {metres(whole)} after"
        f" {end / HOUR:.1f} h."
    )
    return text, OPEN if end < 2 * HOUR else decide(whole > 1.2 * half, whole < 1.05 * half)


@claim("bounded", "section 4.2.1, third", "With aiding the error is bounded and stable.")
def _bounded(results: Results) -> Decision:
    parts, ratios = [], []
    for quantity, sigma in LOW.items():
        outcome = results.at(quantity, sigma, 30)
        end = float(outcome.time[-1])
        second, last = outcome.rms_between(HOUR, 2 * HOUR), outcome.rms_between(end - HOUR, end)
        parts.append(
            f"{quantity}: {number(second)} m RMS in the second hour, {number(last)} m in the last"
        )
        ratios.append(last / second if end >= 3 * HOUR else np.nan)
    return "; ".join(parts) + ".", decide(max(ratios) < 1.5, max(ratios) > 2.0)


@claim(
    "benefit",
    "section 4.2.1, fourth",
    "The benefit of aiding appears after 2 hours.",
    why=reasons.early,
)
def _benefit(results: Results) -> Decision:
    times = {
        quantity: benefit_time(results.at(quantity, sigma, 30)) for quantity, sigma in LOW.items()
    }
    default = {
        quantity: benefit_time(results.at(quantity, sigma, 30, DEFAULT))
        for quantity, sigma in LOW.items()
    }
    text = "; ".join(
        f"{quantity}: {after(times[quantity])} ({DEFAULT}: {after(default[quantity])})"
        for quantity in times
    )
    if results.unaided("precision").time[-1] < BENEFIT_TIME:
        return text + ".", OPEN
    near = [abs(time - BENEFIT_TIME) < 0.5 * HOUR for time in times.values()]
    return text + ".", decide(all(near), not any(near))


@claim(
    "jagged",
    "section 4.2.1, fifth",
    "The aided curves are jagged by the aiding interval of 300 s, though averaged over 100 runs.",
)
def _jagged(results: Results) -> Decision:
    outcome = results.at("gravity", LOW["gravity"], 30)
    steps = np.abs(np.diff(outcome.rms))
    at_fix = np.isin(outcome.time[1:], outcome.fix_time)
    if not at_fix.any():
        return "no batch.", OPEN
    jump, between = float(np.median(steps[at_fix])), float(np.median(steps[~at_fix]))
    text = (
        f"The RMS error changes by {metres(jump)} (median) at a batch end, by {metres(between)}"
        " from scan to scan elsewhere."
    )
    return text, decide(jump > 3.0 * between, jump < 1.5 * between)


def _trend(results: Results, pairs: list[tuple[Outcome, Outcome]], names: list[str]) -> Decision:
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
    return _trend(
        results, pairs, [f"{q}, T = {length}, high against low noise" for q, length in cases]
    )


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
    return _divergence(
        results, [(q, s) for q, s in HIGH.items()], [(q, s) for q, s in LOW.items()]
    )


def _divergence(
    results: Results, more: list[tuple[str, float]], less: list[tuple[str, float]]
) -> Decision:
    parts, higher, lower = [], [], []
    for (quantity, a), (_, b) in zip(more, less, strict=True):
        for length in (30, 15):
            first, second = results.at(quantity, a, length), results.at(quantity, b, length)
            runs = len(first.run_means)
            published = next(
                r for r in ROWS if (r.quantity, r.sigma, r.batch_length) == (quantity, a, length)
            )
            intervals = rate_interval(first.diverged, runs), rate_interval(second.diverged, runs)
            parts.append(
                f"{quantity}, T = {length}: {second.diverged} and {first.diverged} of {runs}"
            )
            higher.append(intervals[0][0] > intervals[1][1])
            lower.append(intervals[0][1] < published.divergence_rate)
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
    text, verdict = _trend(
        results, pairs, [f"{q}, {s:g} m/s²: T = 15 against 30" for q, s in cases]
    )
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


@claim(
    "little data",
    "discussion, first",
    "Local and temporal correlation make the match robust with few samples, where area correlation"
    " needs very many.",
    why=reasons.ambiguous,
)
def _little_data(results: Results) -> Decision:
    ours, rival = (
        results.at("gravity", LOW["gravity"], 30),
        results.outcomes[Setting(matcher=RIVAL)],
    )
    count = len(rival.run_means)
    mine = float(ours.run_means[:count].mean())
    text = (
        f"With T = 30 samples: {PAPER} {number(mine)} m, {RIVAL} (area correlation)"
        f" {number(rival.mean)} m (the same {count} runs)."
    )
    score = paired(rival, ours)
    return text, decide(score > 2.0 and rival.mean > 1.5 * mine, score < -2.0)


@claim(
    "drag",
    "discussion, second",
    "The iterations drag the navigator's belief to the place where the signals were sensed.",
    why=reasons.ambiguous,
)
def _drag(results: Results) -> Decision:
    if not results.snapshots:
        return "No batch.", OPEN
    before = np.array([snapshot.error[0] for snapshot in results.snapshots])
    after = np.array([snapshot.error[-1] for snapshot in results.snapshots])
    closer = int((after < before).sum())
    text = (
        f"In {closer} of {len(before)} batches of the first run the last scan ends closer to the"
        f" truth than it began; median error {metres(float(np.median(before)))} before,"
        f" {metres(float(np.median(after)))} after."
    )
    low, high = rate_interval(closer, len(before))
    return text, decide(low > 0.5, high < 0.5)


@claim(
    "short batch suffices",
    "discussion, third",
    "With a low-noise sensor a short batch gives robust aiding without divergence.",
    why=reasons.overconfident,
)
def _short_suffices(results: Results) -> Decision:
    outcomes = [results.at(quantity, sigma, 15) for quantity, sigma in LOW.items()]
    runs = len(outcomes[0].run_means)
    text = "; ".join(
        f"{o.setting.quantity}: {o.diverged} of {runs} diverged, {number(o.mean)} m"
        for o in outcomes
    )
    counts = [o.diverged for o in outcomes]
    return text + ".", decide(
        counts == [0, 0] and runs >= 30, rate_interval(max(counts), runs)[0] > 0.01
    )


@claim(
    "other sensors",
    "discussion, fourth",
    "The algorithm may be used with gradients, magnetometers or terrain.",
)
def _other_sensors(results: Results) -> Decision:
    return (
        "Not simulated by this command; `isogal match` takes recorded tracks of any scalar field.",
        OPEN,
    )
