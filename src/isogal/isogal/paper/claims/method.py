"""Claims about the method: the map look-up, the iterations, retrodiction, the variability
(paper, sections 2 and 3)."""

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.cases import Setting
from isogal.paper.claims import reasons
from isogal.paper.claims.verdicts import OPEN, Decision, claim, decide, metres
from isogal.paper.measure import roughness
from isogal.paper.results import Results


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
    last = most = np.nan
    if results.snapshots:
        movement = np.array([snapshot.movement for snapshot in results.snapshots])
        last, most = np.median(movement[:, -1]), np.median(movement.max(axis=1))
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


RULES = (
    _ambiguity,
    _iterations,
    _retrodiction,
    _variability,
)
"""In the paper's order."""
