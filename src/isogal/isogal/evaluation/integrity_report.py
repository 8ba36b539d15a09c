"""The integrity section of the report of runs: how often the protection level was exceeded."""

from typing import Any

from isogal.evaluation.figures.stanford import stanford_figure
from isogal.evaluation.html_report import Illustration, Section, Table, number
from isogal.evaluation.integrity import Solution
from isogal.evaluation.records import Runs
from isogal.scenario import Integrity


def integrity_section(runs: Runs, settings: Integrity, found: dict[str, Any]) -> Section:
    """Return the section: Stanford diagram and table of exceedances.

    Parameters
    ----------
    runs : Runs
    settings : Integrity
        Of their scenario.
    found : dict
        `integrity` of their summary.
    """
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
    figure = stanford_figure(Solution.of(runs), settings)
    return Section(
        "Integrity",
        [text],
        illustrations=[Illustration("stanford", figure, caption)],
        tables=[exceedance_table(found)],
    )


def exceedance_table(found: dict[str, Any]) -> Table:
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


def integrity_row(found: dict[str, Any]) -> tuple[str, str, str]:
    """Return the row of the key figures."""
    level = found["level"]
    name = f"Protection level, {found['risk']:g} per hour (m; in sigmas)"
    return name, f"{number(level['median'])}; {number(level['median_sigmas'])}", ""
