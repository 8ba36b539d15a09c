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
from isogal.evaluation.results import IntegritySummary, Number, Summary
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
    many, shown = len(runs) > 1, assumed.each_field[0]
    sections = [
        _accuracy(runs, bound, many),
        _integrity(runs, assumed.integrity, summary["integrity"]),
        *_single(runs, reading_sigma(shown), channels_of(first_map(field_map))[0], many),
        _declined(runs),
        _scenario(summary["scenario"], assumed.field_names[0], field_map),
    ]
    what = f"{len(runs)} runs" if many else "Run"
    title = f"{what}: {' and '.join(_measured(assumed, field_map))}"
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


def _measured(assumed: Assumed, field_map: "RunMap") -> list[str]:
    """Return each field, with its noise."""
    found = []
    for one, its_map in zip(assumed.each_field, each_map(field_map), strict=True):
        sigma = f"{reading_sigma(one):g}".replace("e-0", "e-")
        found.append(f"{one.measured_field} matching, sigma {sigma} {its_map.unit}")
    return found


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
    error, bound = summary["position_error"], summary["bound"]
    nees, fixes, time = summary["nees_per_axis"], summary["fixes"], summary["time"]
    level = summary["integrity"]
    interval = "" if None in nees["interval"] else f"; {_interval(nees['interval'])}"
    rows = [
        ("Mean position error (m)", number(error["mean"]), number(error["mean_after_1h"])),
        *_against_bound("", error, "Posterior Cramér–Rao bound, RMS (m)", bound),
        *_of_smoothed(summary),
        ("Unaided INS, mean (m)", number(summary["unaided"]["mean"]), ""),
        ("Unaided INS, RMS (m)", number(summary["unaided"]["rms"]), ""),
        (f"NEES per axis (1 is right{interval})", number(nees["mean"]), ""),
        ("NEES per axis at all scans", number(summary["nees_all_scans"]["mean"]), ""),
        *(
            (f"Runs {text}", f"{len(summary['judgement']['runs'][kind])} of {summary['runs']}", "")
            for kind, text in KINDS.items()
        ),
        (
            f"Protection level, {level['risk']:g} per hour (m; in sigmas)",
            f"{number(level['level']['median'])}; {number(level['level']['median_sigmas'])}",
            "",
        ),
        ("Fixes published / declined", f"{fixes['published']} / {fixes['declined']}", ""),
        ("Batches on which the matcher failed", str(fixes["failed"]), ""),
        ("Fixes that the navigator rejected", str(fixes["rejected"]), ""),
        ("Computing time of a fix, median (ms)", number(time["fix_ms_median"]), ""),
        ("Wall time (s)", number(time["wall_s"]), ""),
    ]
    filled = [(name, whole, later or number(None)) for name, whole, later in rows]
    return Table("Key figures.", ("", "whole run", "after the first hour"), filled)


def _of_smoothed(summary: Summary) -> list[tuple[str, str, str]]:
    """Return the rows of the key figures about smoothed states; none where there are none."""
    if "smoothed" not in summary:
        return []
    found = summary["smoothed"]
    error, nees = found["position_error"], found["nees_per_axis"]
    causal = _ratio(error["rms_after_1h"], summary["position_error"]["rms_after_1h"])
    return [
        *_against_bound("Smoothed: ", error, "Smoothed: bound, RMS (m)", found["bound"]),
        ("Smoothed: RMS error over that of the time", number(found["of_causal"]), causal),
        (f"Smoothed: NEES per axis ({_interval(nees['interval'])})", number(nees["mean"]), ""),
    ]


def _interval(ends: Sequence[Number]) -> str:
    return f"95 % interval {' to '.join(number(end) for end in ends)}"


def _against_bound(
    whose: str, error: dict[str, Number], name: str, bound: dict[str, Number]
) -> list[tuple[str, str, str]]:
    """Return the rows of an RMS error, its bound, which has a name, and the ratio of both."""
    times = "rms", "rms_after_1h"
    first, later = (_ratio(error[time], bound[time]) for time in times)
    return [
        (f"{whose}RMS position error (m)", number(error["rms"]), number(error["rms_after_1h"])),
        (name, number(bound["rms"]), number(bound["rms_after_1h"])),
        (f"{whose}RMS error over bound", first, later),
    ]


def _ratio(value: float | None, reference: float | None) -> str:
    return "–" if not value or not reference else number(value / reference)


def _accuracy(runs: Runs, bound: BoundResult, many: bool) -> Section:
    time = runs.elapsed + bound.time[0]
    later = None if bound.smoothed is None else bound.smoothed_rms_at(time)
    caption = (
        f"{'RMS over the runs' if many else 'Of one run'}: horizontal position error of the aided"
        " and of the unaided navigator, and the posterior Cramér–Rao bound, which is an RMS over"
        " many runs"
    )
    if not many:
        caption += (
            ": a single run may lie below it at times, and does where its error changes sign"
        )
    figure = ensemble_figure(runs, bound.rms_at(time), later)
    pictures = [Illustration("position_error", figure, f"{caption}.")]
    if runs.published.any():
        caption = (
            "Normalised estimation error squared of the navigator right after each fix. Values"
            " above the band say that the navigator believes itself better than it is."
        )
        pictures.append(Illustration("nees", nees_figure(runs), caption))
    return Section("Accuracy and consistency", illustrations=pictures)


def _integrity(runs: Runs, settings: Integrity, found: IntegritySummary) -> Section:
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
    measured = number(time["measured"])
    text = (
        f"Events in {number(found['run_hours'])} h: states above the level that are at most"
        f" {time['assumed']:g} s apart, the assumed correlation time of the error (measured in"
        f" these runs: {measured} s), are one event."
    )
    figure = stanford_figure(runs, settings)
    return Section(
        "Integrity",
        [text],
        illustrations=[Illustration("stanford", figure, caption)],
        tables=[exceedance_table(found)],
    )


def exceedance_table(found: IntegritySummary) -> Table:
    """Return the table of exceedances of `integrity`."""
    rows = [
        (
            f"{it['risk']:g}",
            str(it["events"]),
            number(it["rate"]),
            " to ".join(number(end) for end in it["interval"]),
            it["verdict"],
        )
        for it in found["exceedances"]
    ]
    alerts = found["alert_limit"]
    if alerts is not None:
        it = alerts["hazardous"]
        what = f"error beyond {alerts['limit']:g} m, level within"
        interval = " to ".join(number(end) for end in it["interval"])
        rows.append((what, str(it["events"]), number(it["rate"]), interval, ""))
    header = ("allowed per hour", "events", "per hour", "95 % interval", "")
    return Table("How often the error exceeded the protection level.", header, rows)


def _single(runs: Runs, sigma: float, field_map: "ScalarMap", many: bool) -> list[Section]:
    pictures = [
        Illustration(
            "track",
            track_figure(runs, field_map),
            "The track on the map, the unaided navigator and the fixes.",
        ),
        Illustration(
            "north_east_error",
            error_figure(runs),
            "North and east error with the 3-sigma band that the navigator claims. Fixes are shown"
            " with 1-sigma bars of the measurements alone.",
        ),
    ]
    sections = [
        Section("Track and errors" + (" of the first run" if many else ""), illustrations=pictures)
    ]
    if runs.detail is not None:
        measured = signal_figure(runs, field_map, sigma)
        caption = (
            "Reduced readings and the map's values. Slow differences to the map at the true"
            " position come from the reduction with the navigator's wrong velocity, and from the"
            " map's error where it has one."
        )
        picture = Illustration("measured", measured, caption)
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
    return Section(
        "Fixes", tables=[Table("Why batches gave no fix.", ("reason", "batches"), rows)]
    )
