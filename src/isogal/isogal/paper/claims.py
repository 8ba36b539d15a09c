"""The paper's claims, each decided from what was measured: holds, does not hold, cannot tell.

Means of the same runs are compared in pairs (the same random numbers), and a difference counts
from two of its standard errors. Shares of diverged runs are compared by their exact binomial 95 %
intervals. The claims are about the paper's own matcher, and so are the verdicts.

First what a claim is and the statistics it is decided by, then the claims in the paper's order.
docs/paper.md says what the likely cause is where one does not hold."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.html_report import number
from isogal.paper.cases import DEFAULT, PAPER, RIVAL, Setting
from isogal.paper.measure import Outcome, Results, roughness
from isogal.paper.published import (
    BENEFIT_TIME,
    GAIN_TIME,
    HIGH,
    LOW,
    QUANTUM_GAIN,
    ROWS,
    TABLE_4,
)

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot tell"
HOUR = 3600.0
"""s."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper, what was measured about it, and the verdict."""

    key: str
    where: str
    """Where the paper makes it."""
    claim: str
    measured: str
    verdict: str
    """`HOLDS`, `FAILS` or `OPEN`."""


Decision = tuple[str, str]
"""What was measured, in words, and what follows."""
RULES: dict[str, Callable[[Results], Claim]] = {}
"""By key, in the paper's order: what decides each claim."""


def claim(key: str, where: str) -> Callable[[Callable[[Results], Decision]], None]:
    """Make the decorated function the rule for the claim that its docstring repeats."""

    def register(decision: Callable[[Results], Decision]) -> None:
        text = " ".join((decision.__doc__ or "").split())
        RULES[key] = lambda results: Claim(key, where, text, *decision(results))

    return register


def judge(results: Results) -> tuple[Claim, ...]:
    """Decide all claims."""
    return tuple(decided(results) for decided in RULES.values())


def decide(condition: bool, opposite: bool) -> str:
    """Return the verdict of two exclusive findings; neither = cannot tell."""
    return HOLDS if condition else FAILS if opposite else OPEN


def metres(value: float) -> str:
    """Write a length."""
    return f"{number(value)} m"


def after(seconds: float) -> str:
    """Write a time since the start; NaN = never."""
    if not np.isfinite(seconds):
        return "never"
    return "from the start" if seconds < 60.0 else f"after {seconds / HOUR:.1f} h"


def listed(parts: Iterable[str]) -> str:
    """Write findings as one sentence."""
    return "; ".join(parts) + "."


def score(differences: Array) -> float:
    """Mean of independent values in its standard errors; 0 for a single one, or where all are
    0."""
    if len(differences) < 2 or not differences.any():
        return 0.0
    error = differences.std(ddof=1) / np.sqrt(len(differences))
    return float(differences.mean() / max(error, 1e-12))


def paired(a: Outcome, b: Outcome) -> float:
    """Difference of the mean errors of the same runs, in its standard errors."""
    count = min(len(a.run_means), len(b.run_means))
    return score(a.run_means[:count] - b.run_means[:count])


def rate_interval(count: int, total: int) -> tuple[float, float]:
    """Exact 95 % confidence interval of a share (Clopper and Pearson 1934)."""
    from scipy.stats import binomtest

    interval = binomtest(count, total).proportion_ci(method="exact")
    return float(interval.low), float(interval.high)


def quantum_gain(results: Results) -> tuple[float, float]:
    """Share by which quantum accelerometers reduce the unaided RMS error, and its standard error
    (jackknife over runs; NaN for a single run)."""
    precision, quantum = results.unaided("precision"), results.unaided("quantum_accelerometer")
    index = int(np.argmin(np.abs(precision.time - results.plan.gain_time)))
    a, b = precision.unaided[:, index] ** 2, quantum.unaided[:, index] ** 2
    gain = 1.0 - float(np.sqrt(b.mean() / a.mean()))
    if len(a) < 2:
        return gain, float("nan")
    left_out = 1.0 - np.sqrt((b.sum() - b) / (a.sum() - a))
    return gain, float(np.sqrt((len(a) - 1) * np.mean((left_out - left_out.mean()) ** 2)))


def benefit_time(outcome: Outcome) -> float:
    """Time (s) from which on the aided RMS error stays below the unaided one; NaN if it never
    does."""
    worse = np.flatnonzero(outcome.rms >= outcome.unaided_rms)
    last = int(worse[-1]) if worse.size else -1
    return float(outcome.time[last + 1]) if last + 1 < len(outcome.time) else float("nan")


def _unaided_at(outcome: Outcome, parts: Iterable[float]) -> list[float]:
    """Unaided RMS error (m) after parts of the whole time."""
    times = [part * outcome.time[-1] for part in parts]
    return [float(np.interp(time, outcome.time, outcome.unaided_rms)) for time in times]


def _growth(outcome: Outcome) -> str:
    """Decide whether the unaided error grows in the second half of the time."""
    half, whole = _unaided_at(outcome, (0.5, 1.0))
    if outcome.time[-1] < 2 * HOUR:
        return OPEN
    return decide(whole > 1.2 * half, whole < 1.05 * half)


def _trend(pairs: list[tuple[Outcome, Outcome]], names: list[str]) -> Decision:
    """Decide whether the first of each pair errs more than the second."""
    scores = [paired(a, b) for a, b in pairs]
    text = listed(
        f"{name}: {number(a.mean)} m against {number(b.mean)} m"
        for name, (a, b) in zip(names, pairs, strict=True)
    )
    return text, decide(min(scores) > 2.0, min(scores) < -2.0)


def _no_divergence(outcomes: list[Outcome]) -> str:
    """Decide whether no run diverges."""
    most, runs = max(outcome.diverged for outcome in outcomes), len(outcomes[0].run_means)
    return decide(most == 0 and runs >= 30, rate_interval(most, runs)[0] > 0.01)


@claim("ambiguity", "section 2")
def _ambiguity(results: Results) -> Decision:
    """One reading may match more than one place in the search window."""
    share = results.profile.ambiguous
    text = (
        f"Along a line to the east it does at {100 * share:.0f} % of the places along the track"
        " (window of 8 km)."
    )
    return text, decide(share > 0.1, share < 0.01)


@claim("iterations", "section 3.2")
def _iterations(results: Results) -> Decision:
    """After 15 iterations, hardly any difference between two iterations is left."""
    last = most = np.nan
    if results.snapshots:
        movement = np.array([snapshot.movement for snapshot in results.snapshots])
        last, most = np.median(movement[:, -1]), np.median(movement.max(axis=1))
    text = (
        f"The 15th iteration moves the batch by {metres(float(last))} (median of"
        f" {len(results.snapshots)} batches), the largest step is {metres(float(most))}."
    )
    return text, decide(last < 0.05 * most, last > 0.1 * most)


@claim("retrodiction", "section 3.3")
def _retrodiction(results: Results) -> Decision:
    """The estimated trajectory is smoother with retrodiction."""
    parts, ratios = [], []
    for length in (30, 15):
        standard = results.tracks[Setting(batch_length=length)]
        tracks = results.tracks[Setting(batch_length=length, mode="retrodiction")]
        a, b, c = roughness(standard.live), roughness(tracks.live), roughness(tracks.revised)
        parts.append(
            f"T = {length}: the error changes by {metres(a)} RMS from scan to"
            f" scan with standard aiding, by {metres(c)} in the track that retrodiction leaves"
            f" behind (as output at the time: {metres(b)})"
        )
        ratios.append(c / a)
    return listed(parts), decide(max(ratios) < 0.8, min(ratios) > 1.0)


@claim("variability", "section 3.3")
def _variability(results: Results) -> Decision:
    """The map feature variability reflects how much the data vary along the track."""
    from scipy.stats import spearmanr

    signal = results.signal["disturbance"]
    window = 30
    if len(signal.signal) < 4 * window:
        return "The runs are too short.", OPEN
    varies = np.lib.stride_tricks.sliding_window_view(signal.signal, window).std(axis=1)
    middle = signal.variability[window // 2 :][: len(varies)]
    correlation = float(spearmanr(varies, middle).statistic)
    text = (
        f"Rank correlation of the variability with the standard deviation of {window} readings"
        f" around: {number(correlation, 2)}."
    )
    return text, decide(correlation > 0.4, correlation < 0.2)


@claim("unbounded", "section 4.2.1, first")
def _unbounded(results: Results) -> Decision:
    """Without aiding the RMS error grows without bound, even with high-end sensors."""
    outcome = results.unaided("precision")
    quarters = ", ".join(map(number, _unaided_at(outcome, (0.25, 0.5, 0.75, 1.0))))
    hours = outcome.time[-1] / HOUR
    return f"Precision grade: {quarters} m after each quarter of {hours:.1f} h.", _growth(outcome)


@claim("quantum gain", "section 4.2.1, second")
def _quantum_gain(results: Results) -> Decision:
    """Quantum accelerometers reduce the RMS error after 3.5 h by a little over 6 %."""
    gain, error = quantum_gain(results)
    drift = results.drift
    theory = ", ".join(
        f"{100 * (1 - drift[heading, 'quantum_accelerometer'] / value):.2f} % with {heading:g} rad"
        " of heading error"
        for (heading, grade), value in drift.items()
        if grade == "precision"
    )
    text = f"{100 * gain:.2f} % (2 standard errors: {200 * error:.2f} %); by theory {theory}."
    if results.plan.gain_time < GAIN_TIME:
        return text, OPEN
    near = abs(gain - QUANTUM_GAIN) < max(2 * error, 0.01)
    return text, decide(near and 2 * error < 0.02, not near)


@claim("quantum drift", "section 4.2.1, second")
def _quantum_drift(results: Results) -> Decision:
    """With quantum accelerometers the drift is still unbounded."""
    outcome = results.unaided("quantum_accelerometer")
    half, whole = _unaided_at(outcome, (0.5, 1.0))
    hours = outcome.time[-1] / HOUR
    text = f"{metres(half)} RMS after {hours / 2:.1f} h, {metres(whole)} after {hours:.1f} h."
    return text, _growth(outcome)


@claim("bounded", "section 4.2.1, third")
def _bounded(results: Results) -> Decision:
    """With aiding the error is bounded and stable."""
    parts, ratios = [], []
    for quantity, sigma in LOW.items():
        outcome = results.at(quantity, sigma, 30)
        end = float(outcome.time[-1])
        second, last = outcome.rms_between(HOUR, 2 * HOUR), outcome.rms_between(end - HOUR, end)
        parts.append(
            f"{quantity}: {number(second)} m RMS in the second hour, {number(last)} m in the last"
        )
        ratios.append(last / second if end >= 3 * HOUR else np.nan)
    return listed(parts), decide(max(ratios) < 1.5, max(ratios) > 2.0)


@claim("benefit", "section 4.2.1, fourth")
def _benefit(results: Results) -> Decision:
    """The benefit of aiding appears after 2 hours."""
    times = {
        (quantity, matcher): benefit_time(results.at(quantity, sigma, 30, matcher))
        for quantity, sigma in LOW.items()
        for matcher in (PAPER, DEFAULT)
    }
    text = listed(
        f"{quantity}: {after(times[quantity, PAPER])}"
        f" ({DEFAULT}: {after(times[quantity, DEFAULT])})"
        for quantity in LOW
    )
    if results.unaided("precision").time[-1] < BENEFIT_TIME:
        return text, OPEN
    near = [abs(times[quantity, PAPER] - BENEFIT_TIME) < 0.5 * HOUR for quantity in LOW]
    return text, decide(all(near), not any(near))


@claim("jagged", "section 4.2.1, fifth")
def _jagged(results: Results) -> Decision:
    """The aided curves are jagged by the aiding interval of 300 s, though averaged over 100
    runs."""
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


@claim("sensor", "section 4.2.1, fifth; discussion, third")
def _sensor(results: Results) -> Decision:
    """The error depends on the precision of the field sensor."""
    cases = [(q, length) for q in LOW for length in (30, 15)]
    pairs = [(results.at(q, HIGH[q], n), results.at(q, LOW[q], n)) for q, n in cases]
    return _trend(pairs, [f"{q}, T = {length}, high against low noise" for q, length in cases])


@claim("resolution", "section 4.2.1, fifth")
def _resolution(results: Results) -> Decision:
    """The error depends on the resolution of the map."""
    maps = [results.plan.field_map(Setting(quantity=quantity)) for quantity in LOW]
    cells = " m and ".join(f"{field_map.cell_size_m(-0.64)[0]:.0f}" for field_map in maps)
    text = f"Both maps have the same cells here ({cells} m north-south), so nothing was compared."
    return text, OPEN


@claim("500 m", "section 4.2.2")
def _five_hundred(results: Results) -> Decision:
    """With gravity at 1e-5 m/s² the mean error is somewhat above 500 m."""
    parts, low, high = [], [], []
    for row in TABLE_4[:2]:
        outcome, default = results.row(row), results.row(row, DEFAULT)
        error = outcome.mean_uncertainty
        parts.append(
            f"T = {row.batch_length}: {number(outcome.mean)} ± {number(error, 2)} m"
            f" ({DEFAULT}: {number(default.mean)} m)"
        )
        low.append(outcome.mean - 2 * error)
        high.append(outcome.mean + 2 * error)
    near = min(high) > 500.0 and max(low) < 600.0
    return listed(parts), decide(near, max(high) < 500.0 or min(low) > 600.0)


@claim("divergence by noise", "section 4.2.2")
def _divergence_by_noise(results: Results) -> Decision:
    """Runs diverge more often when the sensor is noisier."""
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


@claim("T and noise", "section 4.2.2")
def _batch_and_noise(results: Results) -> Decision:
    """The two noise levels differ more with T = 15 than with T = 30."""
    parts, scores = [], []
    for q in LOW:
        short, long = (
            results.at(q, HIGH[q], length).run_means - results.at(q, LOW[q], length).run_means
            for length in (15, 30)
        )
        parts.append(
            f"{q}: {metres(float(short.mean()))} with T = 15,"
            f" {metres(float(long.mean()))} with T = 30"
        )
        scores.append(score(short - long))
    return listed(parts), decide(min(scores) > 2.0, max(scores) < 2.0 and min(scores) < -2.0)


@claim("shorter batches", "section 4.1")
def _shorter(results: Results) -> Decision:
    """Short batches (T = 15) err and diverge more than long ones (T = 30)."""
    cases = [(row.quantity, row.sigma) for row in ROWS if row.batch_length == 30]
    pairs = [(results.at(q, s, 15), results.at(q, s, 30)) for q, s in cases]
    text, verdict = _trend(pairs, [f"{q}, {s:g} m/s²: T = 15 against 30" for q, s in cases])
    counts = [sum(o.diverged for o in side) for side in zip(*pairs, strict=True)]
    return f"{text[:-1]}; diverged runs in all: {counts[0]} against {counts[1]}.", verdict


@claim("no divergence", "section 4.2.2")
def _none_diverges(results: Results) -> Decision:
    """With gravity at low noise no run diverges, with T = 15 as with T = 30."""
    outcomes = [results.row(row) for row in TABLE_4[:2]]
    long, short = (f"{outcome.diverged} of {results.plan.runs}" for outcome in outcomes)
    return f"T = 30: {long}, T = 15: {short}.", _no_divergence(outcomes)


@claim("maps alike", "section 4.2.3")
def _maps_alike(results: Results) -> Decision:
    """The disturbance map gives no significantly different errors than the gravity map."""
    parts, ratios = [], []
    for name, level in (("low", LOW), ("high", HIGH)):
        for length in (30, 15):
            gravity, disturbance = (
                results.at(quantity, level[quantity], length).mean
                for quantity in ("gravity", "disturbance")
            )
            ratios.append(disturbance / gravity)
            parts.append(f"{number(ratios[-1])} ({name} noise, T = {length})")
    text = f"Mean error with disturbance over that with gravity: {', '.join(parts)}."
    least, most = min(ratios), max(ratios)
    return text, decide(least > 0.67 and most < 1.5, least < 0.5 or most > 2.0)


@claim("first hour", "section 4.2.3")
def _first_hour(results: Results) -> Decision:
    """The error is overwhelmingly large in the first hour, because the map varies little there."""
    outcome = results.at("disturbance", LOW["disturbance"], 30)
    signal = results.signal["disturbance"]
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
        text += " On this map the first hour does not vary less."
        return text, OPEN if first > later else FAILS
    return text, decide(first > 1.5 * later, first < 1.1 * later)


@claim("little data", "discussion, first")
def _little_data(results: Results) -> Decision:
    """Local and temporal correlation make the match robust with few samples, where area
    correlation needs very many."""
    ours, rival = results.at("gravity", LOW["gravity"], 30), results.outcomes[RIVAL]
    count = len(rival.run_means)
    mine = float(ours.run_means[:count].mean())
    text = (
        f"With T = 30 samples: {PAPER} {number(mine)} m, {RIVAL.matcher} (area correlation)"
        f" {number(rival.mean)} m (the same {count} runs)."
    )
    worse = paired(rival, ours)
    return text, decide(worse > 2.0 and rival.mean > 1.5 * mine, worse < -2.0)


@claim("drag", "discussion, second")
def _drag(results: Results) -> Decision:
    """The iterations drag the navigator's belief to the place where the signals were sensed."""
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


@claim("short batch suffices", "discussion, third")
def _short_suffices(results: Results) -> Decision:
    """With a low-noise sensor a short batch gives robust aiding without divergence."""
    outcomes = [results.at(quantity, sigma, 15) for quantity, sigma in LOW.items()]
    text = listed(
        f"{o.setting.quantity}: {o.diverged} of {len(o.run_means)} diverged, {number(o.mean)} m"
        for o in outcomes
    )
    return text, _no_divergence(outcomes)


@claim("other sensors", "discussion, fourth")
def _other_sensors(_: Results) -> Decision:
    """The algorithm may be used with gradients, magnetometers or terrain."""
    text = (
        "Not simulated by this command; `isogal match` takes recorded tracks of any scalar field."
    )
    return text, OPEN
