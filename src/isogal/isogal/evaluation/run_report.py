"""The report of `isogal run` and of `isogal montecarlo`: figures and tables of a record of
runs."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from isogal.evaluation.bound import BoundResult
from isogal.evaluation.figures.errors import (
    ensemble_figure,
    error_figure,
    nees_figure,
    stanford_figure,
)
from isogal.evaluation.figures.signal import signal_figure
from isogal.evaluation.figures.track import track_figure
from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.evaluation.judgement import KINDS
from isogal.evaluation.records import Runs
from isogal.evaluation.results import Number, Summary
from isogal.fields.measured import reading_sigma
from isogal.files import Json
from isogal.maps.channels import channels_of
from isogal.maps.several import each_map, first_map
from isogal.scenario import Assumed, Integrity

if TYPE_CHECKING:
    from isogal.maps.several import RunMap
    from isogal.maps.tiled_map import ScalarMap


def run_report(
    runs: Runs,
    assumed: Assumed,
    field_map: "RunMap",
    bound: BoundResult,
    out_dir: str | Path,
    summary: Summary,
) -> Path:
    """Write `report.html` and its PNG figures for one run or many.

    Parameters
    ----------
    runs : Runs
        One run is shown in detail; of many, the ensemble and the first run.
    assumed : Assumed
        What filter and matcher assumed in them.
    field_map : FieldMap, TiledMap or ChannelMap, or FieldMaps of several fields
        The map they were matched against; of several channels or fields the first is shown.
    bound : BoundResult
        `posterior_cramer_rao` of what is true.
    out_dir : path
        Folder to write into.
    summary : Summary
        `summarise` of the runs.

    Returns
    -------
    Path
        Of the page.
    """
    fields = list(zip(assumed.each_field, each_map(field_map), strict=True))
    shown, its_map = fields[0][0], channels_of(first_map(field_map))[0]
    sections = [
        _accuracy(runs, bound),
        _integrity(runs, assumed.integrity, summary["integrity"]),
        *_of_first_run(runs, reading_sigma(shown), its_map),
        _declined(runs),
        _scenario(summary["scenario"], assumed.field_names[0], field_map),
    ]
    measured = " and ".join(
        f"{one.measured_field} matching, sigma {f'{reading_sigma(one):g}'.replace('e-0', 'e-')}"
        f" {of_field.unit}"
        for one, of_field in fields
    )
    title = f"{len(runs)} runs: {measured}" if len(runs) > 1 else f"Run: {measured}"
    return write_report(
        out_dir, title, sections, [key_figures(summary)], subtitle_of(runs, assumed)
    )


def subtitle_of(runs: Runs, assumed: Assumed) -> str:
    """Return a line that says what was run."""
    matcher = assumed.each_field[0].matcher
    return (
        f"Matcher {matcher.name}, batches of {matcher.batch_length} scans,"
        f" {assumed.imu.grade.replace('_', ' ')} inertial sensors, seed {assumed.seed},"
        f" {runs.elapsed[-1] / 3600:.2f} h"
    )


def _scenario(document: dict[str, Json], first: str, field_map: "RunMap") -> Section:
    texts = []
    for one in each_map(field_map):
        channels = len(channels_of(one))
        of_many = f", the first of {channels} that are matched; figures show it alone"
        texts.append(f"Map: {one.provenance or one.quantity}{of_many if channels > 1 else ''}.")
    if len(texts) > 1:
        texts.append(f"Figures of map and readings show the first, {first}.")
    return Section(
        "Scenario",
        texts,
        listing=yaml.safe_dump(document, sort_keys=False, allow_unicode=True),
    )


def key_figures(summary: Summary) -> Table:
    """Return the table of the figures of merit, given `summarise` of runs."""
    nees, fixes, time = summary["nees_per_axis"], summary["fixes"], summary["time"]
    level, error = summary["integrity"]["level"], summary["position_error"]
    interval = "" if None in nees["interval"] else f"; {_interval(nees['interval'])}"
    risk, runs = summary["integrity"]["risk"], summary["judgement"]["runs"]
    rows = [
        _both("Mean position error (m)", error, "mean"),
        *_against_bound("", summary, "Posterior Cramér–Rao bound, RMS (m)"),
    ]
    if "smoothed" in summary:
        smoothed = summary["smoothed"]
        later = _ratio(smoothed["position_error"]["rms_after_1h"], error["rms_after_1h"])
        of_smoothed = smoothed["nees_per_axis"]
        name = f"Smoothed: NEES per axis ({_interval(of_smoothed['interval'])})"
        rows += [
            *_against_bound("Smoothed: ", smoothed, "Smoothed: bound, RMS (m)"),
            ("Smoothed: RMS error over that of the time", number(smoothed["of_causal"]), later),
            (name, number(of_smoothed["mean"])),
        ]
    rows += [
        ("Unaided INS, mean (m)", number(summary["unaided"]["mean"])),
        ("Unaided INS, RMS (m)", number(summary["unaided"]["rms"])),
        (f"NEES per axis (1 is right{interval})", number(nees["mean"])),
        ("NEES per axis at all scans", number(summary["nees_all_scans"]["mean"])),
        *(
            (f"Runs {text}", f"{len(runs[kind])} of {summary['runs']}")
            for kind, text in KINDS.items()
        ),
        (
            f"Protection level, {risk:g} per hour (m; in sigmas)",
            f"{number(level['median'])}; {number(level['median_sigmas'])}",
        ),
        ("Fixes published / declined", f"{fixes['published']} / {fixes['declined']}"),
        ("Batches on which the matcher failed", str(fixes["failed"])),
        ("Fixes that the navigator rejected", str(fixes["rejected"])),
        ("Computing time of a fix, median (ms)", number(time["fix_ms_median"])),
        ("Wall time (s)", number(time["wall_s"])),
    ]
    filled = [(*row, number(None))[:3] for row in rows]
    return Table("Key figures.", ("", "whole run", "after the first hour"), filled)


def _interval(ends: Sequence[Number]) -> str:
    return f"95 % interval {' to '.join(map(number, ends))}"


def _both(name: str, values: Summary, key: str) -> tuple[str, ...]:
    """Return a row of a figure of the whole run and of the time after the first hour."""
    return name, number(values[key]), number(values[f"{key}_after_1h"])


def _against_bound(whose: str, found: Summary, bound: str) -> list[tuple[str, ...]]:
    """Return the rows of the RMS error of a summary or of its section, the bound, which has a
    name, and the ratio of both."""
    error, least = found["position_error"], found["bound"]
    ratios = [_ratio(error[key], least[key]) for key in ("rms", "rms_after_1h")]
    return [
        _both(f"{whose}RMS position error (m)", error, "rms"),
        _both(bound, least, "rms"),
        (f"{whose}RMS error over bound", *ratios),
    ]


def _ratio(value: float | None, reference: float | None) -> str:
    return number(value / reference if value and reference else None)


def _accuracy(runs: Runs, bound: BoundResult) -> Section:
    time = runs.elapsed + bound.time[0]
    later = None if bound.smoothed is None else bound.smoothed_rms_at(time)
    whose, below = "RMS over the runs", ""
    if len(runs) == 1:
        whose = "Of one run"
        below = ": a single run may lie below it at times, and does where its error changes sign"
    caption = (
        f"{whose}: horizontal position error of the aided and of the unaided navigator, and the"
        f" posterior Cramér–Rao bound, which is an RMS over many runs{below}."
    )
    figure = ensemble_figure(runs, bound.rms_at(time), later)
    pictures = [Illustration("position_error", figure, caption)]
    if runs.published.any():
        caption = (
            "Normalised estimation error squared of the navigator right after each fix. Values"
            " above the band say that the navigator believes itself better than it is."
        )
        pictures.append(Illustration("nees", nees_figure(runs), caption))
    return Section("Accuracy and consistency", illustrations=pictures)


def _integrity(runs: Runs, settings: Integrity, found: Summary) -> Section:
    """Return the section of the Stanford diagram and the table of exceedances, given `integrity`
    of the summary."""
    caption = (
        "Horizontal error and horizontal protection level of every state. To the right of the"
        " diagonal the error is larger than the level: misleading information."
    )
    if settings.alert_limit is not None:
        caption += (
            f" Dotted: the alert limit, {settings.alert_limit:g} m. Hazardous is an error beyond"
            " it while the level is within."
        )
    time = found["correlation_time"]
    text = (
        f"Events in {number(found['run_hours'])} h: states above the level that are at most"
        f" {time['assumed']:g} s apart, the assumed correlation time of the error (measured in"
        f" these runs: {number(time['measured'])} s), are one event."
    )
    picture = Illustration("stanford", stanford_figure(runs, settings), caption)
    return Section("Integrity", [text], [picture], [exceedance_table(found)])


def exceedance_table(found: Summary) -> Table:
    """Return the table of exceedances of `integrity`."""
    every = [(f"{it['risk']:g}", it, it["verdict"]) for it in found["exceedances"]]
    if (alerts := found["alert_limit"]) is not None:
        what = f"error beyond {alerts['limit']:g} m, level within"
        every.append((what, alerts["hazardous"], ""))
    rows = [
        (
            name,
            str(it["events"]),
            number(it["rate"]),
            " to ".join(map(number, it["interval"])),
            rest,
        )
        for name, it, rest in every
    ]
    header = ("allowed per hour", "events", "per hour", "95 % interval", "")
    return Table("How often the error exceeded the protection level.", header, rows)


def _of_first_run(runs: Runs, sigma: float, field_map: "ScalarMap") -> list[Section]:
    heading = "Track and errors" + (" of the first run" if len(runs) > 1 else "")
    track = "The track on the map, the unaided navigator and the fixes."
    errors = (
        "North and east error with the 3-sigma band that the navigator claims. Fixes are shown"
        " with 1-sigma bars of the measurements alone."
    )
    pictures = [
        Illustration("track", track_figure(runs, field_map), track),
        Illustration("north_east_error", error_figure(runs), errors),
    ]
    sections = [Section(heading, illustrations=pictures)]
    if runs.detail is not None:
        caption = (
            "Reduced readings and the map's values. Slow differences to the map at the true"
            " position come from the reduction with the navigator's wrong velocity, and from the"
            " map's error where it has one."
        )
        picture = Illustration("measured", signal_figure(runs, field_map, sigma), caption)
        sections.append(Section("What the sensor saw", illustrations=[picture]))
    return sections


def _declined(runs: Runs) -> Section:
    # without the figures of each batch
    counts = Counter(
        re.sub(r"\d[\d.]*(e[-+]?\d+)?", "…", reason)
        for reason in runs.fix_reason[~runs.published].tolist()
    )
    if not counts:
        return Section("Fixes", ["Every batch gave a fix."])
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    rows = [(reason, str(count)) for reason, count in ordered]
    table = Table("Why batches gave no fix.", ("reason", "batches"), rows)
    return Section("Fixes", tables=[table])
