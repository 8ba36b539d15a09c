"""All numbers of the reproduction as one document (results.json)."""

from collections.abc import Sequence
from typing import Any

from isogal.paper.cases import MATCHERS
from isogal.paper.claims.statistics import quantum_gain
from isogal.paper.claims.verdicts import Claim
from isogal.paper.measure import Outcome, Spread, Tracks, roughness
from isogal.paper.published import QUANTUM_GAIN, TABLE_4, TABLE_6, PublishedRow
from isogal.paper.results import Results


def as_json(results: Results, claims: Sequence[Claim]) -> dict[str, Any]:
    """Return all numbers as one document.

    The figures of merit of each case are in the format of results.json of a Monte Carlo, without
    the computing times."""
    gain, error = quantum_gain(results)
    return {
        "tables": {
            name: [_row(results, row) for row in rows]
            for name, rows in (("4", TABLE_4), ("6", TABLE_6))
        },
        "unaided": [_spread(spread) for spread in results.spreads],
        "quantum_gain": {
            "published": QUANTUM_GAIN,
            "time": results.plan.gain_time,
            "measured": gain,
            "standard_error": error,
        },
        "drift_by_theory": [
            {"heading": heading, "grade": grade, "rms": value}
            for (heading, grade), value in results.drift.items()
        ],
        "smoothness": [_smoothness(tracks) for tracks in results.tracks.values()],
        "claims": [_claim(claim) for claim in claims],
        "cases": {
            setting.name: {k: v for k, v in outcome.summary.items() if k != "time"}
            for setting, outcome in results.outcomes.items()
        },
    }


def _row(results: Results, row: PublishedRow) -> dict[str, Any]:
    return {
        "batch_length": row.batch_length,
        "sigma": row.sigma,
        "snr": results.snr(row),
        "published": {
            "mean": row.mean_error,
            "divergence_rate": row.divergence_rate,
            "snr": row.snr,
        },
        **{matcher: _brief(results.row(row, matcher)) for matcher in MATCHERS},
    }


def _brief(outcome: Outcome) -> dict[str, Any]:
    summary = outcome.summary
    return {
        "mean": outcome.mean,
        "mean_standard_error": outcome.mean_uncertainty,
        "rms": summary["position_error"]["rms"],
        "rms_after_1h": summary["position_error"]["rms_after_1h"],
        "bound": summary["bound"],
        "nees_per_axis": summary["nees_per_axis"],
        "declined": summary["fixes"]["declined"],
        "divergence_rate": outcome.diverged / len(outcome.run_means),
    }


def _spread(spread: Spread) -> dict[str, Any]:
    return {
        "grade": spread.grade,
        "time": spread.time,
        "rms": spread.rms,
        "claimed": spread.claimed,
        "nees_per_axis": spread.test.nees,
        "interval": list(spread.test.family_interval),
        "consistent": spread.test.consistent,
    }


def _smoothness(tracks: Tracks) -> dict[str, Any]:
    return {
        "batch_length": tracks.setting.batch_length,
        "mode": tracks.setting.mode,
        "as_output": roughness(tracks.live),
        "in_the_end": roughness(tracks.revised),
    }


def _claim(claim: Claim) -> dict[str, str]:
    return {
        "key": claim.key,
        "where": claim.source,
        "claim": claim.text,
        "measured": claim.measured,
        "verdict": claim.verdict,
        "why": claim.why,
    }
