"""Tables of the page. Each row names its cells by column."""

from collections.abc import Mapping, Sequence

from isogal.evaluation.html_report import Table, number
from isogal.paper.cases import AIDING, MATCHERS, PAPER
from isogal.paper.claims import Claim, rate_interval
from isogal.paper.figures import GRADE_LABELS
from isogal.paper.measure import Outcome, Results, roughness
from isogal.paper.published import PublishedRow


def _table(caption: str, rows: Sequence[Mapping[str, str]]) -> Table:
    """Make a table with the columns of the longest row; a dash stands for a missing cell."""
    header = max(map(list, rows), key=len)
    return Table(caption, header, [[row.get(column, "–") for column in header] for row in rows])


def _whole(text: str) -> str:
    """Keep a cell's text in one line."""
    return text.replace(" ", "\N{NO-BREAK SPACE}").replace("-", "\N{NON-BREAKING HYPHEN}")


def _mean(outcome: Outcome) -> str:
    """Write the mean error with its standard error."""
    return _whole(f"{number(outcome.mean)} ± {number(outcome.mean_uncertainty, 2)}")


def _diverged(outcome: Outcome) -> str:
    """Write the share of diverged runs with its 95 % interval."""
    count, total = outcome.diverged, len(outcome.run_means)
    low, high = rate_interval(count, total)
    return _whole(f"{100 * count / total:.0f} % ({100 * low:.0f} to {100 * high:.0f})")


def _interval(ends: Sequence[float | None]) -> str:
    return _whole(" to ".join(map(number, ends)))


def comparison_table(results: Results, rows: Sequence[PublishedRow], name: str) -> Table:
    """Table 4 or 6: the paper's values, its matcher here, and the default matcher."""
    caption = (
        f"{name}: mean position error over runs and time with its standard error, RMS, ratio to"
        " the posterior Cramér–Rao bound, normalised error squared of the navigator after a fix"
        " (1 is right), and diverged runs with their 95 % interval."
    )
    cells = []
    for row in rows:
        published = {
            "T": f"{row.batch_length}",
            "sigma (m/s²)": f"{row.sigma:g}",
            "SNR (dB): paper / here": f"{row.snr:.0f} / {results.snr(row):.0f}",
            "from": "paper",
            "mean error (m)": number(row.mean_error),
            "diverged runs": f"{100 * row.divergence_rate:.0f} %",
        }
        blank = dict.fromkeys(list(published)[:3], "")
        here = [blank | _measured(results.row(row, matcher)) for matcher in MATCHERS]
        cells += [published, *here]
    return _table(caption, cells)


def _measured(outcome: Outcome) -> dict[str, str]:
    summary = outcome.summary
    error, bound, nees = summary["position_error"], summary["bound"], summary["nees_per_axis"]
    reached, least = error["rms_after_1h"], bound["rms_after_1h"]
    ratio = reached / least if reached and least else None
    declined, published = summary["fixes"]["declined"], summary["fixes"]["published"]
    return {
        "from": _whole(outcome.setting.matcher),
        "mean error (m)": _mean(outcome),
        "RMS (m)": number(error["rms"]),
        "RMS after 1 h (m)": number(error["rms_after_1h"]),
        "bound after 1 h (m)": number(bound["rms_after_1h"]),
        "RMS over bound": number(ratio),
        "NEES per axis": number(nees["mean"]),
        "consistent within": _interval(nees["interval"]),
        "declined fixes": f"{100 * declined / max(published + declined, 1):.1f} %",
        "diverged runs": _diverged(outcome),
    }


def spread_table(results: Results) -> Table:
    """Return the RMS error of the unaided INS by grade, and whether its filter's covariance agrees
    with it."""
    runs = len(results.unaided("precision").run_means)
    caption = (
        f"Unaided INS, {runs} runs of each grade: RMS error, what the filter's covariance says"
        " without any fix, and their normalised ratio, which is chi-square distributed; the"
        " interval is that in which all instants of a grade lie together with 95 % probability."
    )
    cells = []
    for spread in results.spreads:
        low, high = spread.interval
        instants = zip(spread.time, spread.rms, spread.claimed, spread.nees_per_axis, strict=True)
        for index, (time, rms, claimed, nees) in enumerate(instants):
            row = {
                "grade": GRADE_LABELS[spread.grade] if index == 0 else "",
                "time (h)": f"{time / 3600:.1f}",
                "RMS (m)": number(float(rms)),
                "by the filter (m)": number(float(claimed)),
                "NEES per axis": number(float(nees)),
                "interval": _interval(spread.interval),
                "agrees": "yes" if low <= nees <= high else "no",
            }
            cells.append(row)
    return _table(caption, cells)


def aiding_table(results: Results) -> Table:
    """Return both ways of aiding side by side."""
    count = len(next(iter(results.tracks.values())).live)
    caption = (
        f"Both ways of aiding, {PAPER}, gravity, sigma 1e-5 m/s². The change of the error from"
        f" scan to scan (RMS, {count} runs) says how smooth a track is: as output at the time, and"
        " as it stands in the end, after later batches have gone back to it."
    )
    cells = []
    for setting in AIDING:
        outcome, tracks = results.outcomes[setting], results.tracks[setting]
        row = {
            "T": f"{setting.batch_length}",
            "aiding": setting.mode,
            "mean error (m)": _mean(outcome),
            "RMS (m)": number(outcome.summary["position_error"]["rms"]),
            "NEES per axis": number(outcome.summary["nees_per_axis"]["mean"]),
            "change per scan as output (m)": number(roughness(tracks.live)),
            "change per scan in the end (m)": number(roughness(tracks.revised)),
            "diverged runs": _diverged(outcome),
        }
        cells.append(row)
    return _table(caption, cells)


def claims_table(claims: Sequence[Claim]) -> Table:
    """Return every claim with what was measured and the verdict."""
    rows = [(claim.where, claim.claim, claim.measured, claim.verdict) for claim in claims]
    header = "where", "claim", "measured here", "verdict"
    return Table("What the paper says, and what is found here.", header, rows)
