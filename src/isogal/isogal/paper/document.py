"""The page: every table and figure of the paper, what the paper says about it, and whether that
holds here."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from isogal.evaluation.html_report import Illustration, Section, number, write_report
from isogal.paper.cases import DEFAULT, PAPER, Setting
from isogal.paper.claims.verdicts import FAILS, HOLDS, OPEN, Claim
from isogal.paper.figures.errors import (
    noise_figure,
    overview_figure,
    retrodiction_figure,
    sensitivity_figure,
    spread_figure,
)
from isogal.paper.figures.maps import lookup_1d_figure, map_figure, search_window_figure
from isogal.paper.figures.signals import iterations_figure, readings_figure, variability_figure
from isogal.paper.published import JOURNEY, TABLE_4, TABLE_6
from isogal.paper.results import Results
from isogal.paper.tables import (
    aiding_table,
    claims_table,
    comparison_table,
    sensitivity_table,
    spread_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_page(
    results: Results, claims: Sequence[Claim], out: str | Path, journey: float, perfect: float
) -> Path:
    """Write `report.html` and the PNG files into a folder.

    Parameters
    ----------
    results, claims
        What was measured and decided.
    out : path
        Folder.
    journey : float
        s, how long the vehicle takes for the whole route.
    perfect : float
        m, RMS error of the unaided INS (precision grade) at `Plan.gain_time` without any initial
        error.
    """
    by_key = {claim.key: claim for claim in claims}
    duration = results.plan.duration / 3600.0
    provenance = results.plan.field_map(Setting()).provenance or "gravity map"
    sections = [
        _verdicts(claims),
        Section(
            "Table 4: gravity",
            tables=[comparison_table(results, TABLE_4, "Paper Table 4, gravity map")],
        ),
        Section(
            "Table 6: disturbance",
            tables=[comparison_table(results, TABLE_6, "Paper Table 6, gravity disturbance map")],
        ),
        _limits(results, journey, perfect, by_key),
        _lookup(results, by_key),
        _inertial(results, by_key),
        _noise(results, by_key),
        _iterations(results, by_key),
        _aiding(results, by_key),
    ]
    subtitle = (
        f"{results.plan.runs} runs a case of {duration:.1f} h at {Setting().speed:g} m/s; map:"
        f" {provenance}. {PAPER} is the paper's matcher to the letter, {DEFAULT} the default one."
    )
    return write_report(
        out, "Probabilistic map matching: the paper, reproduced", sections, subtitle=subtitle
    )


def _verdicts(claims: Sequence[Claim]) -> Section:
    verdicts = [claim.verdict for claim in claims]
    text = (
        f"Of {len(claims)} statements of the paper {verdicts.count(HOLDS)} hold in this"
        f" simulation, {verdicts.count(FAILS)} do not, and {verdicts.count(OPEN)} cannot be"
        " decided by it. Verdicts follow from the numbers beside them by fixed rules, for the"
        " paper's own matcher."
    )
    return Section("What the paper says", [text], tables=[claims_table(claims)])


def _limits(
    results: Results, journey: float, perfect: float, claims: Mapping[str, Claim]
) -> Section:
    speed = Setting().speed
    unaided = results.unaided("precision").summary["unaided"]
    paragraphs = [
        (
            f"Duration. The paper's route takes {journey / 3600:.1f} h at its speed of {speed:g}"
            f" m/s; the paper says more than {JOURNEY / 3600:.1f} h. The first"
            f" {results.plan.duration / 3600:.1f} h are simulated here."
        ),
        (
            "Initial errors. The paper does not state any, but its unaided errors need them: with"
            " the sensors of its Table 1 and a perfect start the RMS error after"
            f" {results.plan.gain_time / 3600:.1f} h would be {number(perfect)} m. Assumed here"
            " (1-sigma): 50 m, 0.05 m/s, 2.5e-5 rad of tilt, 3e-4 rad of heading; the unaided"
            f" error is then {number(unaided['rms'])} m RMS over the run."
        ),
        (
            f"Gain by quantum accelerometers. Measured: {claims['quantum gain'].measured} The"
            " paper's value cannot come from its Table 1: the drift is that of the heading error"
            " and of the gyroscopes, which the accelerometers do not change."
        ),
        (
            "Choices. The paper leaves open the candidates' covariance, the search window's"
            " threshold and the weighting by map feature variability; docs/paper.md says what was"
            " chosen. Errors of the gravimeter's reductions (Eötvös, free air) are simulated here"
            " and reduced with the navigator's own estimate, which the paper does not mention."
        ),
    ]
    picture = Illustration(
        "sensitivity",
        sensitivity_figure(results),
        "Sensitivity of the RMS error over the run to the initial heading error and to the speed."
        " Gravity, sigma 1e-5 m/s², T = 30.",
    )
    return Section(
        "What cannot be reproduced, and what it depends on",
        paragraphs,
        [picture],
        [sensitivity_table(results)],
    )


def _picture(
    number: str,
    drawn: "Figure",
    what: str,
    claims: Mapping[str, Claim] = MappingProxyType({}),
    keys: Sequence[str] = (),
) -> Illustration:
    """Return a figure of the paper with its caption, and the verdicts of the claims about it."""
    parts = [f"Paper fig. {number}. {what}"]
    for claim in (claims[key] for key in keys):
        text = f"{claim.text[0].lower()}{claim.text[1:].rstrip('.')}"
        parts.append(f"The paper: {text}. Here this {_said(claim)}.")
    return Illustration(f"fig-{number}", drawn, " ".join(parts))


def _said(claim: Claim) -> str:
    return "cannot be decided" if claim.verdict == OPEN else claim.verdict


def _lookup(results: Results, claims: Mapping[str, Claim]) -> Section:
    plan = results.plan
    window = results.window
    field_map = plan.field_map(Setting())
    prior_error = float((window.truth**2).sum() ** 0.5)
    error = float(((window.combined - window.truth) ** 2).sum() ** 0.5)
    pictures = [
        _picture(
            "51",
            map_figure(plan, "gravity"),
            "Gravity map and the vehicle's track.",
            claims,
            ["resolution"],
        ),
        _picture(
            "57",
            map_figure(plan, "disturbance"),
            "Gravity disturbance map and the vehicle's track.",
            claims,
            ["resolution"],
        ),
        _picture(
            "54a",
            lookup_1d_figure(results.profile, field_map),
            "Map lookup along a line: a reading belongs to all places in the window where the map"
            " has its value.",
            claims,
            ["ambiguity"],
        ),
        _picture(
            "54",
            search_window_figure(window, field_map),
            f"Search window (dashed) with the {len(window.weight)} map points nearest in value to"
            " the reading (white line: where the map has it). The prior is"
            f" {number(prior_error)} m from the truth, the PDA solution {number(error)} m: one"
            " reading alone says little, and its mean need not lie where the map has its value.",
        ),
    ]
    return Section("Maps and the map lookup", illustrations=pictures)


def _inertial(results: Results, claims: Mapping[str, Claim]) -> Section:
    pictures = [
        _picture(
            "52",
            overview_figure(results),
            "RMS position error of the unaided INS by grade (PCAG and QAPCG coincide), and aided"
            " with T = 30 at low noise.",
            claims,
            ["unbounded", "quantum gain", "bounded", "benefit", "jagged"],
        ),
        Illustration(
            "unaided-spread",
            spread_figure(results),
            "Does the filter know the spread of the unaided INS? RMS error of the runs, and what"
            " the filter's covariance says when it takes no fix.",
        ),
    ]
    return Section(
        "The inertial navigator, aided and unaided",
        illustrations=pictures,
        tables=[spread_table(results)],
    )


def _noise(results: Results, claims: Mapping[str, Claim]) -> Section:
    figures = (
        ("56", "gravity", 30, ("sensor", "500 m")),
        ("56b", "gravity", 15, ("T and noise", "no divergence")),
        ("61", "disturbance", 30, ("maps alike", "first hour")),
        ("61a", "disturbance", 15, ("shorter batches",)),
    )
    pictures = [
        _picture(
            "56a",
            readings_figure(results),
            "Gravity readings of one run at each noise level, reduced with the navigator's"
            " estimate, against the noiseless signal. Below, the differences: noise, and what a"
            " wrong velocity leaves of the Eötvös term.",
        ),
        *(
            _picture(
                name,
                noise_figure(results, quantity, length),
                f"RMS position error, {quantity} map, T = {length}.",
                claims,
                keys,
            )
            for name, quantity, length, keys in figures
        ),
        _picture(
            "60",
            variability_figure(results),
            "Noiseless gravity disturbance along the track, and the map feature variability (eq."
            " CV) as it is and over its mean of the last 100 scans.",
            claims,
            ["variability"],
        ),
    ]
    return Section("Noise, batch length and map", illustrations=pictures)


def _iterations(results: Results, claims: Mapping[str, Claim]) -> Section:
    picture = _picture(
        "64",
        iterations_figure(results),
        "Left: one batch of T = 15 scans from the navigator's track to the result of the last"
        " iteration. Right: how far each iteration moves the batches of this run.",
        claims,
        ["iterations", "drag"],
    )
    return Section("Iterations", illustrations=[picture])


def _aiding(results: Results, claims: Mapping[str, Claim]) -> Section:
    claim = claims["retrodiction"]
    caption = (
        f"Standard aiding and retrodiction with {PAPER}, gravity, sigma 1e-5 m/s², T = 30. The"
        f" paper: {claim.text[0].lower()}{claim.text[1:]} Here this {_said(claim)}, for the track"
        " as it stands in the end; what is output at the time still jumps when a batch comes."
    )
    picture = Illustration("retrodiction", retrodiction_figure(results), caption)
    return Section("Two ways of aiding", illustrations=[picture], tables=[aiding_table(results)])
