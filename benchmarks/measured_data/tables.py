"""The tables of docs/evidence/real-data.md, from the results of real_data.py.
Lengths in km, gravity in mGal, magnetic anomalies in nT."""

import math
from collections.abc import Mapping

import numpy as np
from closed_loop import cells_of, markdown

from isogal.tracks.map_error import SMOOTHING
from measured_data.clear_lake import Lake
from measured_data.lines import MGAL
from measured_data.matches import Summary
from measured_data.scotland import Part


def tables(clear_lake: Lake, scotland: Mapping[str, Part], untold: Mapping[str, Summary]) -> str:
    """Return all of them, in Markdown."""
    parts = [
        ("Clear Lake, how wrong the map is", nis_table(clear_lake)),
        ("Clear Lake, whole lines", whole_table(clear_lake)),
        ("Clear Lake, after n stations", growth_table(clear_lake)),
        ("Clear Lake, batches of 30", batch_table(clear_lake)),
        ("Scotland", scotland_table(scotland)),
        ("Nothing specified", untold_table(untold)),
    ]
    return "\n".join(f"{title}\n\n{table}\n" for title, table in parts)


def nis_table(lake: Lake) -> str:
    """NIS per reading and of a line's mean residual, with independent and with correlated
    errors."""
    header = (
        *("stations", "L", "sensor", "NIS, independent errors", "NIS, correlated"),
        *("NIS of the mean, independent", "NIS of the mean, correlated"),
    )
    sizes = np.array([lake["stations"][name] for name in lake["whole"]], dtype=float)
    means = sizes @ np.array([lake["nis"][name] for name in lake["whole"]]) / sizes.sum()
    rows = []
    for name, found in [*lake["nis"].items(), ("all lines, mean", means)]:
        fit = lake["settings"].get(name, lake["settings"]["all lines"])
        settings = f"{fit['correlation_length'] / 1e3:.2f}", f"{fit['sensor_sigma'] / MGAL:.2f}"
        white, white_mean, correlated, mean = found
        shown = f"{white:.2f}", f"{correlated:.2f}", f"{white_mean:.1f}", f"{mean:.1f}"
        rows.append([name, *(settings if found is not means else ("", "")), *shown])
    return markdown(header, rows)


def whole_table(lake: Lake) -> str:
    """Whole lines, each from some directions: error, 1-sigma and NEES per axis."""
    header = (
        *("line", "correlated: error", "1-sigma", "NEES"),
        "likelihood alone: NEES",
        *("nothing learnt: error", "1-sigma", "NEES"),
        *("white noise: error", "1-sigma", "NEES"),
        "least squares: error",
    )
    rows = []
    for name in lake["whole"]:
        whole, bare, unlearnt, white = (
            _whole(lake[kind][name]) for kind in ("whole", "bare", "unlearnt", "white")
        )
        rigid = f"{np.median(lake['rigid_m'][name]) / 1e3:.2f}"
        rows.append([name, *whole, bare[-1], *unlearnt, *white, rigid])
    return markdown(header, rows)


def _whole(summary: Summary) -> list[str]:
    if not summary["fixes"]:
        return ["no fix", "", ""]
    missing = summary["batches"] - summary["fixes"]
    note = f" ({missing} of {summary['batches']} no fix)" if missing else ""
    return [
        f"{summary['error_median_m'] / 1e3:.2f}{note}",
        f"{summary['sigma_long_median_m'] / 1e3:.2f}",
        f"{summary['nees_per_axis']:.1f}",
    ]


def growth_table(lake: Lake) -> str:
    """Error / long 1-sigma after some stations."""
    counts = sorted({step["readings"] for steps in lake["growth"].values() for step in steps[:-1]})
    rows = []
    for name, steps in lake["growth"].items():
        for kind in ("correlated", "white"):
            at = {step["readings"]: step[kind] for step in steps}
            cells = [
                (
                    f"{at[n]['error_m'] / 1e3:.2f} / {at[n]['sigma_long_m'] / 1e3:.2f}"
                    if n in at
                    else ""
                )
                for n in counts
            ]
            rows.append([f"{name}, {kind}", *cells])
    return markdown(["line", *map(str, counts)], rows)


def batch_table(lake: Lake) -> str:
    """Batches of 30 stations."""
    names = {
        "independent": "correlated",
        "bare": "correlated, likelihood alone",
        "chained": "correlated, chained",
        "white": "white noise",
    }
    return _summaries(
        "batches", {names[kind]: summary for kind, summary in lake["batches"].items()}
    )


def scotland_table(scotland: Mapping[str, Part]) -> str:
    """Whole lines of Scotland, with the map error learnt from the others."""
    kinds: dict[str, Summary] = {}
    for name, part in scotland.items():
        fit = part["settings"]
        learnt = (
            f"L {fit['correlation_length'] / 1e3:.2f}, sensor {fit['sensor_sigma']:.1f}, sigma ="
            f" hypot({fit['floor']:.1f}, {fit['reach'] / 1e3:.2f} km x gradient over"
            f" {SMOOTHING / 1e3:.0f} km)"
        )
        kinds |= {
            f"{name}: {learnt}": part["own"],
            f"{name}: its likelihood alone": part["bare"],
            f"{name}: the same sigma everywhere, {fit['even_sigma']:.0f}": part["even"],
            f"{name}: white noise": part["white"],
            f"{name}: least squares": part["rigid"],
        }
    return _summaries("lines", kinds)


def untold_table(untold: Mapping[str, Summary]) -> str:
    """Lines with nothing told."""
    return _summaries("lines", untold)


_NAMES = (
    *("error_median_m", "error_90_m", "sigma_long_median_m"),
    *("nees_per_axis", "nees_per_axis_median", "nees_low", "nees_high"),
)
_COLUMNS = {
    "fixes": "{fixes} of {batches}",
    "error, median": "{error_median_km:.2f}",
    "error, 90 %": "{error_90_km:.2f}",
    "1-sigma, median": "{sigma_long_median_km:.2f}",
    "NEES, mean": "{nees_per_axis:.1f}",
    "NEES, median": "{nees_per_axis_median:.1f}",
    "95 % of right ones": "{nees_low:.2f} to {nees_high:.2f}",
}


def _summaries(title: str, kinds: Mapping[str, Summary]) -> str:
    """Return a table of summaries; what one has not is a dash."""
    rows = []
    for kind, summary in kinds.items():
        known = dict.fromkeys(_NAMES, math.nan) | summary
        known |= {f"{name[:-2]}_km": known[name] / 1e3 for name in known if name[-2:] == "_m"}
        rows.append([kind, *(cell.replace("nan", "–") for cell in cells_of(known, _COLUMNS))])
    return markdown([title, *_COLUMNS], rows)
