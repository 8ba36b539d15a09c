"""What the numbers say about the cause where a claim of the paper does not hold."""

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.claims.verdicts import HOUR, after, metres
from isogal.paper.published import HIGH, LOW, ROWS, TABLE_4
from isogal.paper.results import Results


def ambiguous(_: Results) -> str:
    """Why a batch may be matched at a wrong place."""
    return (
        "The variance of eq. s3-021 leaves the candidates' spread out, so a scan that matches many"
        " places pulls as hard as one that matches a single one."
    )


def accelerometers(results: Results) -> str:
    """Why better accelerometers hardly reduce the drift."""
    return (
        "With the sensors of Table 1 the drift is that of the initial heading error and of the"
        f" gyroscopes; at {number(results.plan.gain_time / HOUR)} h better accelerometers change"
        " little, whatever the initial errors."
    )


def early(results: Results) -> str:
    """Why the benefit of aiding begins earlier than in the paper."""
    outcome = results.at("gravity", LOW["gravity"], 30)
    level = float(np.sqrt(np.mean(outcome.error**2)))
    above = np.flatnonzero(outcome.unaided_rms > level)
    when = after(float(outcome.time[above[0]])) if above.size else "never"
    return (
        f"The unaided error passes the level of the aided one ({metres(level)}) {when}. That time"
        " is set by the initial errors, which the paper does not state."
    )


def windows(results: Results) -> str:
    """Why runs with short batches do not diverge more often here."""

    def share(length: int) -> str:
        worst = max(
            results.at(q, s, length).excluded for level in (LOW, HIGH) for q, s in level.items()
        )
        return f"{100 * worst:.1f} %"

    return (
        "The paper sees the cause of divergence in search windows that do not hold the true"
        f" place. Here they miss it at {share(15)} of the batch ends at most with T = 15, at"
        f" {share(30)} with T = 30; and fixes of shorter batches come twice as often."
    )


def overconfident(results: Results) -> str:
    """Why more precise readings do not make the paper's matcher more accurate."""
    nees = [
        float(results.row(row).summary["nees_per_axis"]["mean"])
        for row in ROWS
        if row.sigma == LOW[row.quantity]
    ]
    return (
        "With low noise the paper's matcher believes too much in its fixes (NEES per axis"
        f" {number(min(nees))} to {number(max(nees))} where 1 is right), which spoils what better"
        " readings would give."
    )


def method(results: Results) -> str:
    """Why the mean error differs from the paper's."""
    bounds = [float(results.row(row).summary["bound"]["rms"]) for row in TABLE_4[:2]]
    return (
        f"The bound is {metres(max(bounds))} RMS: errors of this size come from the method and not"
        " from the sensor, and depend on what the paper leaves open (candidates' covariance,"
        " window, weight by variability)."
    )
