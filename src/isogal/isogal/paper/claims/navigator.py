"""Claims about the inertial navigator, unaided and aided, over time (paper, section 4.2.1)."""

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.cases import DEFAULT
from isogal.paper.claims import reasons
from isogal.paper.claims.statistics import benefit_time, quantum_gain
from isogal.paper.claims.verdicts import HOUR, OPEN, Decision, after, claim, decide, metres
from isogal.paper.published import BENEFIT_TIME, GAIN_TIME, LOW, QUANTUM_GAIN
from isogal.paper.results import Results


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
    drift = results.drift
    theory = {
        heading: 1 - drift[heading, "quantum_accelerometer"] / drift[heading, "precision"]
        for heading, grade in drift
        if grade == "precision"
    }
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


RULES = (
    _unbounded,
    _quantum_gain,
    _quantum_drift,
    _bounded,
    _benefit,
    _jagged,
)
"""In the paper's order."""
