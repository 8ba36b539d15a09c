"""The tables of docs/evidence/real-data.md, from the results of real_data.py.
Lengths in km, gravity in mGal, magnetic anomalies in nT."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from isogal.tracks.map_error import SMOOTHING
from measured_data.lines import MGAL


def tables(results: dict[str, Any]) -> str:
    """Return all of them, in Markdown."""
    lake, scotland = results["clear_lake"], results["scotland"]
    parts = [
        ("Clear Lake, how wrong the map is", nis_table(lake)),
        ("Clear Lake, whole lines", whole_table(lake)),
        ("Clear Lake, after n stations", growth_table(lake)),
        ("Clear Lake, batches of 30", batch_table(lake)),
        ("Scotland", scotland_table(scotland)),
        ("Nothing specified", untold_table(results["untold"])),
    ]
    return "\n".join(f"{title}\n\n{table}\n" for title, table in parts)


def _markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def nis_table(lake: dict[str, Any]) -> str:
    """NIS per reading and of a line's mean residual, with independent and with correlated
    errors."""
    header = (
        "stations",
        "L",
        "sensor",
        "NIS, independent errors",
        "NIS, correlated",
        "NIS of the mean, independent",
        "NIS of the mean, correlated",
    )
    rows = []
    for name, (white, white_mean, correlated, mean) in lake["nis"].items():
        fit = lake["settings"].get(name, lake["settings"]["all lines"])
        settings = [f"{fit['correlation_length'] / 1e3:.2f}", f"{fit['sensor_sigma'] / MGAL:.2f}"]
        rows.append(
            [
                name,
                *settings,
                f"{white:.2f}",
                f"{correlated:.2f}",
                f"{white_mean:.1f}",
                f"{mean:.1f}",
            ]
        )
    sizes = np.array([lake["stations"][name] for name in lake["whole"]], dtype=float)
    means = sizes @ np.array([lake["nis"][name] for name in lake["whole"]]) / sizes.sum()
    rows.append(
        [
            "all lines, mean",
            "",
            "",
            f"{means[0]:.2f}",
            f"{means[2]:.2f}",
            f"{means[1]:.1f}",
            f"{means[3]:.1f}",
        ]
    )
    return _markdown(header, rows)


def whole_table(lake: dict[str, Any]) -> str:
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
    return _markdown(header, rows)


def _whole(summary: dict[str, Any]) -> list[str]:
    if not summary["fixes"]:
        return ["no fix", "", ""]
    missing = summary["batches"] - summary["fixes"]
    note = f" ({missing} of {summary['batches']} no fix)" if missing else ""
    return [
        f"{summary['error_median_m'] / 1e3:.2f}{note}",
        f"{summary['sigma_long_median_m'] / 1e3:.2f}",
        f"{summary['nees_per_axis']:.1f}",
    ]


def growth_table(lake: dict[str, Any]) -> str:
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
    return _markdown(["line", *map(str, counts)], rows)


def batch_table(lake: dict[str, Any]) -> str:
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


def scotland_table(scotland: dict[str, Any]) -> str:
    """Whole lines of Scotland, with the map error learnt from the others."""
    kinds: dict[str, dict[str, Any]] = {}
    for name, part in scotland.items():
        fit = part["settings"]
        learnt = (
            f"L {fit['correlation_length'] / 1e3:.2f}, sensor {fit['sensor_sigma']:.1f}, sigma ="
            f" hypot({fit['floor']:.1f}, {fit['reach'] / 1e3:.2f} km x gradient over"
            f" {SMOOTHING / 1e3:.0f} km)"
        )
        kinds[f"{name}: {learnt}"] = part["own"] | {"nis": part["nis"]["own"][0]}
        kinds[f"{name}: its likelihood alone"] = part["bare"] | {"nis": part["nis"]["bare"][0]}
        kinds[f"{name}: the same sigma everywhere, {fit['even_sigma']:.0f}"] = part["even"] | {
            "nis": part["nis"]["even"][0]
        }
        kinds[f"{name}: white noise"] = part["white"] | {"nis": part["nis"]["white"][0]}
        rigid = {"fixes": 0, "batches": 0, "nis": float("nan")} | part["rigid"]
        kinds[f"{name}: least squares"] = rigid
    return _summaries("lines", kinds)


def untold_table(untold: dict[str, Any]) -> str:
    """Lines with nothing told."""
    return _summaries("lines", untold)


def _summaries(title: str, kinds: dict[str, dict[str, Any]]) -> str:
    header = [
        title,
        "fixes",
        "error, median",
        "error, 90 %",
        "1-sigma, median",
        "NEES, mean",
        "NEES, median",
    ]
    with_nis = any("nis" in summary for summary in kinds.values())
    rows = []
    for kind, s in kinds.items():
        kilometres = (
            f"{s[key] / 1e3:.2f}" if key in s else "–"
            for key in ("error_median_m", "error_90_m", "sigma_long_median_m")
        )
        nees = (
            f"{s[key]:.1f}" if key in s else "–"
            for key in ("nees_per_axis", "nees_per_axis_median")
        )
        fixes = f"{s['fixes']} of {s['batches']}" if s["batches"] else "all"
        row = [kind, fixes, *kilometres, *nees]
        if with_nis:
            row.append(f"{s['nis']:.2f}" if np.isfinite(s["nis"]) else "–")
        rows.append(row)
    return _markdown([*header, "NIS"] if with_nis else header, rows)
