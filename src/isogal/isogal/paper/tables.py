"""Tables of the page."""

from collections.abc import Sequence
from typing import Any

from isogal.evaluation.html_report import Table, number
from isogal.paper.cases import MATCHERS, PAPER, SWEEP_HEADINGS, SWEEP_SPEEDS, Setting
from isogal.paper.claims.statistics import rate_interval
from isogal.paper.claims.verdicts import Claim
from isogal.paper.figures.errors import GRADE_LABELS
from isogal.paper.measure import Outcome, roughness
from isogal.paper.published import PublishedRow
from isogal.paper.results import Results


def _percent(count: int, total: int) -> str:
    """Write a share of runs with its 95 % interval."""
    low, high = rate_interval(count, total)
    return _whole(f"{100 * count / total:.0f} % ({100 * low:.0f} to {100 * high:.0f})")


def _whole(text: str) -> str:
    """Keep a cell's text in one line."""
    return text.replace(" ", "\N{NO-BREAK SPACE}").replace("-", "\N{NON-BREAKING HYPHEN}")


def _mean(outcome: Outcome) -> str:
    return _whole(f"{number(outcome.mean)} ± {number(outcome.mean_uncertainty, 2)}")


def comparison_table(results: Results, rows: Sequence[PublishedRow], name: str) -> Table:
    """Table 4 or 6: the paper's values, its matcher here, and the default matcher."""
    cells: list[tuple[str, ...]] = []
    for row in rows:
        snr = f"{row.snr:.0f} / {results.snr(row):.0f}"
        title = (f"{row.batch_length}", f"{row.sigma:g}", snr)
        diverged = f"{100 * row.divergence_rate:.0f} %"
        cells.append((*title, "paper", number(row.mean_error), *("–",) * 7, diverged))
        cells += [("", "", "", *_outcome_cells(results.row(row, matcher))) for matcher in MATCHERS]
    header = (
        "T",
        "sigma (m/s²)",
        "SNR (dB): paper / here",
        "from",
        "mean error (m)",
        "RMS (m)",
        "RMS after 1 h (m)",
        "bound after 1 h (m)",
        "RMS over bound",
        "NEES per axis",
        "consistent within",
        "declined fixes",
        "diverged runs",
    )
    caption = (
        f"{name}: mean position error over runs and time with its standard error, RMS, ratio to"
        " the posterior Cramér–Rao bound, normalised error squared of the navigator after a fix"
        " (1 is right), and diverged runs with their 95 % interval."
    )
    return Table(caption, header, cells)


def _outcome_cells(outcome: Outcome) -> tuple[str, ...]:
    summary = outcome.summary
    error, bound, nees = summary["position_error"], summary["bound"], summary["nees_per_axis"]
    fixes = summary["fixes"]
    ratio = None
    if error["rms_after_1h"] and bound["rms_after_1h"]:
        ratio = error["rms_after_1h"] / bound["rms_after_1h"]
    total = fixes["published"] + fixes["declined"]
    return (
        _whole(outcome.setting.matcher),
        _mean(outcome),
        number(error["rms"]),
        number(error["rms_after_1h"]),
        number(bound["rms_after_1h"]),
        number(ratio),
        number(nees["mean"]),
        _whole(" to ".join(number(end) for end in nees["interval"])),
        f"{100 * fixes['declined'] / max(total, 1):.1f} %",
        _percent(outcome.diverged, len(outcome.run_means)),
    )


def spread_table(results: Results) -> Table:
    """Return the RMS error of the unaided INS by grade, and whether its filter's covariance agrees
    with it."""
    cells = []
    for spread in results.spreads:
        low, high = spread.test.family_interval
        for index, time in enumerate(spread.time):
            nees = float(spread.test.nees[index])
            cells.append(
                (
                    GRADE_LABELS[spread.grade] if index == 0 else "",
                    f"{time / 3600:.1f}",
                    number(float(spread.rms[index])),
                    number(float(spread.claimed[index])),
                    number(nees),
                    f"{number(low)} to {number(high)}",
                    "yes" if low <= nees <= high else "no",
                )
            )
    runs = len(results.unaided("precision").run_means)
    caption = (
        f"Unaided INS, {runs} runs of each grade: RMS error, what the filter's covariance says"
        " without any fix, and their normalised ratio, which is chi-square distributed; the"
        " interval is that in which all instants of a grade lie together with 95 % probability."
    )
    header = (
        "grade",
        "time (h)",
        "RMS (m)",
        "by the filter (m)",
        "NEES per axis",
        "interval",
        "agrees",
    )
    return Table(caption, header, cells)


def aiding_table(results: Results) -> Table:
    """Return both ways of aiding side by side."""
    cells = []
    for length in (30, 15):
        for mode in ("standard", "retrodiction"):
            setting = Setting(batch_length=length, mode=mode)
            outcome, tracks = results.outcomes[setting], results.tracks[setting]
            error = outcome.summary["position_error"]
            cells.append(
                (
                    f"{length}",
                    mode,
                    _mean(outcome),
                    number(error["rms"]),
                    number(outcome.summary["nees_per_axis"]["mean"]),
                    number(roughness(tracks.live)),
                    number(roughness(tracks.revised)),
                    _percent(outcome.diverged, len(outcome.run_means)),
                )
            )
    header = (
        "T",
        "aiding",
        "mean error (m)",
        "RMS (m)",
        "NEES per axis",
        "change per scan as output (m)",
        "change per scan in the end (m)",
        "diverged runs",
    )
    count = len(next(iter(results.tracks.values())).live)
    caption = (
        f"Both ways of aiding, {PAPER}, gravity, sigma 1e-5 m/s². The change of the error from"
        f" scan to scan (RMS, {count} runs) says how smooth a track is: as output at the time, and"
        " as it stands in the end, after later batches have gone back to it."
    )
    return Table(caption, header, cells)


def sensitivity_table(results: Results) -> Table:
    """Return errors against what the paper leaves open."""
    cells = []
    for change in _sweep():
        setting = Setting(**change)
        aided = [results.outcomes[Setting(matcher=matcher, **change)] for matcher in MATCHERS]
        theory = [
            results.drift.get((setting.heading, grade))
            for grade in ("precision", "quantum_accelerometer")
        ]
        swept = "speed" not in change
        gain = (
            f"{100 * (1 - theory[1] / theory[0]):.2f} %"
            if swept and theory[0] and theory[1]
            else "–"
        )
        unaided = aided[0].summary["unaided"]
        cells.append(
            (
                f"{setting.heading:g}",
                f"{setting.speed:g}",
                number(theory[0] if swept else None),
                gain,
                number(unaided["rms"]),
                *(_mean(o) for o in aided),
            )
        )
    header = (
        *(
            "heading error (rad)",
            "speed (m/s)",
            f"unaided after {results.plan.gain_time / 3600:.1f} h, theory (m)",
            "quantum gain, theory",
            "unaided, RMS (m)",
        ),
        *(f"{matcher}, mean (m)" for matcher in MATCHERS),
    )
    caption = (
        "Sensitivity to what the paper does not state: gravity, sigma 1e-5 m/s², T = 30; the"
        " sweeps have a fifth of the runs."
    )
    return Table(caption, header, cells)


def _sweep() -> list[dict[str, Any]]:
    speeds = [{"speed": speed} for speed in SWEEP_SPEEDS if speed != Setting().speed]
    return [{"heading": heading} for heading in SWEEP_HEADINGS] + speeds


def claims_table(claims: Sequence[Claim]) -> Table:
    """Return every claim with what was measured and the verdict."""
    rows = [
        (claim.source, claim.text, f"{claim.measured} {claim.why}".strip(), claim.verdict)
        for claim in claims
    ]
    return Table(
        "What the paper says, and what is found here.",
        ("where", "claim", "measured here", "verdict"),
        rows,
    )
