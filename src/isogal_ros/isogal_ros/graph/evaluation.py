"""The evaluation of a run of the graph: summary, report and figures."""

from pathlib import Path
from typing import Any

from isogal.maps.several import RunMap
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.record import record_of


def evaluate(
    collector: Collector,
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: RunMap,
    out: Path,
    wall_seconds: float,
) -> dict[str, Any] | None:
    """Write summary.json, report.html and figures; return the summary, or None where there is
    nothing to evaluate."""
    from isogal.evaluation.bound import posterior_cramer_rao
    from isogal.evaluation.run_report import run_report
    from isogal.evaluation.summary import summarise, write_json

    runs = record_of(collector, field_map)
    if runs is None:
        return None
    bound = posterior_cramer_rao(scenario, trajectory, field_map)
    summary = summarise(
        runs,
        scenario,
        bound.rms_at(runs.time - runs.time[0] + bound.time[0]),
        wall_seconds=wall_seconds,
    )
    write_json(out / "summary.json", summary)
    run_report(runs, scenario, field_map, bound, out, summary)
    return summary
