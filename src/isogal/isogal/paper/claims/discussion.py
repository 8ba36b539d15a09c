"""Claims of the paper's discussion."""

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.cases import PAPER, RIVAL, Setting
from isogal.paper.claims import reasons
from isogal.paper.claims.statistics import paired, rate_interval
from isogal.paper.claims.verdicts import OPEN, Decision, claim, decide, metres
from isogal.paper.published import LOW
from isogal.paper.results import Results


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


RULES = (
    _little_data,
    _drag,
    _short_suffices,
    _other_sensors,
)
"""In the paper's order."""
