"""The page: every table and figure of the paper, what the paper says about it, and whether that
holds here."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isogal.evaluation.html_report import Illustration, Section, number, write_report
from isogal.paper import figures, tables
from isogal.paper.cases import DEFAULT, PAPER, Setting
from isogal.paper.claims import FAILS, HOLDS, OPEN, Claim
from isogal.paper.measure import Results
from isogal.paper.published import SPEED, TABLE_4, TABLE_6

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_page(results: Results, claims: Sequence[Claim], out: str | Path) -> Path:
    """Write `report.html` and the PNG files into a folder."""
    plan = results.plan
    provenance = plan.field_map(Setting()).provenance or "gravity map"
    table_4 = tables.comparison_table(results, TABLE_4, "Paper Table 4, gravity map")
    table_6 = tables.comparison_table(results, TABLE_6, "Paper Table 6, gravity disturbance map")
    by_key = {claim.key: claim for claim in claims}
    sections = [
        Section("What the paper says", [_count(claims)], tables=[tables.claims_table(claims)]),
        Section("Table 4: gravity", tables=[table_4]),
        Section("Table 6: disturbance", tables=[table_6]),
        *_illustrated(results, by_key),
        _aiding(results, by_key["retrodiction"]),
    ]
    subtitle = (
        f"{plan.runs} runs a case of {plan.duration / 3600.0:.1f} h at {SPEED:g} m/s;"
        f" map: {provenance}. {PAPER} is the paper's matcher to the letter, {DEFAULT} the default"
        " one."
    )
    title = "Probabilistic map matching: the paper, reproduced"
    return write_report(out, title, sections, subtitle=subtitle)


def _count(claims: Sequence[Claim]) -> str:
    verdicts = [claim.verdict for claim in claims]
    return (
        f"Of {len(claims)} statements of the paper {verdicts.count(HOLDS)} hold in this"
        f" simulation, {verdicts.count(FAILS)} do not, and {verdicts.count(OPEN)} cannot be"
        " decided by it. Verdicts follow from the numbers beside them by fixed rules, for the"
        " paper's own matcher."
    )


def _said(claim: Claim, scope: str = "") -> str:
    """Write a claim and its verdict for a caption."""
    text = f"{claim.claim[0].lower()}{claim.claim[1:].rstrip('.')}"
    verdict = "cannot be decided" if claim.verdict == OPEN else claim.verdict
    return f"The paper: {text}. Here this {verdict}{scope}."


_RMS = "RMS position error, {} map, T = {}."
_FIGURES = {
    "51": ("Gravity map and the vehicle's track.", "resolution"),
    "57": ("Gravity disturbance map and the vehicle's track.", "resolution"),
    "54a": (
        "Map lookup along a line: a reading belongs to all places in the window where the map has"
        " its value.",
        "ambiguity",
    ),
    "54": (
        "Search window (dashed) with the {candidates} map points nearest in value to the reading"
        " (white line: where the map has it). The prior is {prior} m from the truth, the PDA"
        " solution {error} m: one reading alone says little, and its mean need not lie where the"
        " map has its value.",
    ),
    "52": (
        "RMS position error of the unaided INS by grade (PCAG and QAPCG coincide), and aided with"
        " T = 30 at low noise.",
        *("unbounded", "quantum gain", "bounded", "benefit", "jagged"),
    ),
    "56a": (
        "Gravity readings of one run at each noise level, reduced with the navigator's estimate,"
        " against the noiseless signal. Below, the differences: noise, and what a wrong velocity"
        " leaves of the Eötvös term.",
    ),
    "56": (_RMS.format("gravity", 30), "sensor", "500 m"),
    "56b": (_RMS.format("gravity", 15), "T and noise", "no divergence"),
    "61": (_RMS.format("disturbance", 30), "maps alike", "first hour"),
    "61a": (_RMS.format("disturbance", 15), "shorter batches"),
    "60": (
        "Noiseless gravity disturbance along the track, and the map feature variability (eq. CV)"
        " as it is and over its mean of the last 100 scans.",
        "variability",
    ),
    "64": (
        "Left: one batch of T = 15 scans from the navigator's track to the result of the last"
        " iteration. Right: how far each iteration moves the batches of this run.",
        *("iterations", "drag"),
    ),
}
"""The paper's figures by label: caption, and keys of the claims about it."""


def _drawn(results: Results) -> dict[str, "Figure"]:
    """Return the paper's figures by label."""
    plan, field_map = results.plan, results.plan.field_map(Setting())
    return {
        "51": figures.map_figure(plan, "gravity"),
        "57": figures.map_figure(plan, "disturbance"),
        "54a": figures.lookup_1d_figure(results.profile, field_map),
        "54": figures.search_window_figure(results.window, field_map),
        "52": figures.overview_figure(results),
        "56a": figures.readings_figure(results),
        "56": figures.noise_figure(results, "gravity", 30),
        "56b": figures.noise_figure(results, "gravity", 15),
        "61": figures.noise_figure(results, "disturbance", 30),
        "61a": figures.noise_figure(results, "disturbance", 15),
        "60": figures.variability_figure(results),
        "64": figures.iterations_figure(results),
    }


def _illustrated(results: Results, claims: dict[str, Claim]) -> list[Section]:
    """Return the figures by subject, each with the verdicts of the claims about it."""
    drawn, window = _drawn(results), results.window
    numbers = {
        "candidates": len(window.weight),
        "prior": number(float(np.hypot(*window.truth))),
        "error": number(float(np.hypot(*(window.combined - window.truth)))),
    }

    def pictures(*labels: str) -> list[Illustration]:
        found = []
        for label in labels:
            caption, *keys = _FIGURES[label]
            said = [caption.format(**numbers), *(_said(claims[key]) for key in keys)]
            text = " ".join([f"Paper fig. {label}.", *said])
            found.append(Illustration(f"fig-{label}", drawn[label], text))
        return found

    spread, noise = tables.spread_table(results), pictures("56a", "56", "56b", "61", "61a", "60")
    return [
        Section("Maps and the map lookup", illustrations=pictures("51", "57", "54a", "54")),
        Section("The inertial navigator, aided and unaided", [], pictures("52"), [spread]),
        Section("Noise, batch length and map", illustrations=noise),
        Section("Iterations", illustrations=pictures("64")),
    ]


def _aiding(results: Results, claim: Claim) -> Section:
    scope = (
        ", for the track as it stands in the end; what is output at the time still jumps when a"
        " batch comes"
    )
    table = tables.aiding_table(results)
    return Section("Two ways of aiding", [_said(claim, scope)], tables=[table])
