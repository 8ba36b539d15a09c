"""How much navigation a second of CPU time buys: Isogal's Monte Carlo beside filterpy's filter and
Stone Soup's PMHT, in one call.

    python benchmarks/montecarlo.py [--runs 8] [--matcher pmht-paper] [--json]

Isogal runs the default scenario in closed loop (all runs and all 3.6 h). filterpy's
UnscentedKalmanFilter navigates the first minutes of run 0: the same 15 states, the same IMU
readings, Isogal's strapdown step as fx, the known height as measurement. Stone Soup's PMHTTracker
matches batches of run 0: the same scans, candidates and prior, as many iterations. Both results
are checked against Isogal's before they are timed, so the same work is compared. Times are CPU
times of this process with one thread; rates are extrapolated to an hour of one run.

Stone Soup is not a dependency: pip install -r benchmarks/requirements.txt. Without it that part is
left out, and said so."""

import json
from importlib.util import find_spec

import closed_loop
from comparison.closed_loop import measure_closed_loop
from comparison.filterpy_filter import measure_filters

from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo import engine
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

HOUR = 3600.0
Result = dict[str, str | float | dict[str, float | dict[str, float]]]


def measure(runs: int, matcher: str) -> Result:
    """Measure everything; all rates are run-hours of navigation per CPU second."""
    scenario = validate_scenario({"matcher": {"name": matcher}})
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    duration = float(trajectory.time[-1])
    warm = validate_scenario(
        {"matcher": {"name": matcher, "batch_length": 30}, "route": {"duration": 600.0}}
    )
    engine.simulate(warm, [0], field_map)  # compiles
    seconds, batches = measure_closed_loop(scenario, field_map, runs)
    hours = runs * duration / HOUR
    filters = measure_filters(scenario)
    batch = scenario.matcher.batch_length * scenario.gravimeter.interval
    result: Result = {
        "matcher": matcher,
        "runs": runs,
        "run_hours": hours,
        "closed_loop": {
            "run_hours_per_cpu_second": hours / seconds["all"],
            "share": {
                part: seconds[part] / seconds["all"]
                for part in ("strapdown", "filter", "matching")
            },
            "share_strapdown_in_filter": filters["strapdown_in_filter"] / filters["isogal"],
        },
        "filter": {
            "isogal": 1.0 / (HOUR * filters["isogal"]),
            "filterpy": 1.0 / (HOUR * filters["filterpy"]),
            "ratio": filters["filterpy"] / filters["isogal"],
            "apart_m": filters["apart_m"],
        },
        "closed_loop_over_filterpy_filter": HOUR * filters["filterpy"] * hours / seconds["all"],
    }
    if find_spec("stonesoup") is not None:
        from comparison.stonesoup_pmht import measure_matching

        soup = measure_matching(batches, field_map)
        result["matching"] = {
            "isogal": batch / HOUR / soup["isogal"],
            "stonesoup": batch / HOUR / soup["stonesoup"],
            "ratio": soup["stonesoup"] / soup["isogal"],
            "apart_m": soup["apart_m"],
        }
        result["closed_loop_over_stonesoup_matching"] = (
            hours / seconds["all"] * HOUR / batch * soup["stonesoup"]
        )
    return result


def show(result: Result) -> None:
    loop, filters, matching = result["closed_loop"], result["filter"], result.get("matching")
    share = loop["share"]
    rest = 1.0 - sum(share.values())
    lines = [
        f"Run-hours of navigation per CPU second, one core ({result['runs']} runs of the default"
        " scenario)",
        "",
        f"  Isogal, closed loop with {result['matcher']:<12}"
        f" {loop['run_hours_per_cpu_second']:10.2f}",
        f"    strapdown {share['strapdown']:.0%}, filter {share['filter']:.0%} (of which strapdown"
        f" of the sigma points {loop['share_strapdown_in_filter']:.0%}), matching"
        f" {share['matching']:.0%}, rest {rest:.0%}",
        f"  filter alone:    Isogal {filters['isogal']:8.1f}   filterpy {filters['filterpy']:8.4f}"
        f"   ratio {filters['ratio']:7.0f}",
        "  PMHT alone:      Stone Soup is not installed (pip install -r"
        " benchmarks/requirements.txt)"
        if matching is None
        else f"  PMHT alone:      Isogal {matching['isogal']:8.1f}   Stone Soup"
        f" {matching['stonesoup']:6.4f}   ratio {matching['ratio']:7.0f}",
        "",
        "  Isogal's closed loop over filterpy's filter alone:"
        f" {result['closed_loop_over_filterpy_filter']:.0f} times",
    ]
    checks = f"filterpy's filter ends {filters['apart_m']:.2g} m from ours"
    if matching is not None:
        lines.append(
            "  Isogal's closed loop over Stone Soup's PMHT alone:"
            f" {result['closed_loop_over_stonesoup_matching']:.0f} times"
        )
        checks += (
            f"; Stone Soup's fixes are {matching['apart_m']:.0f} m from ours (median; it has one"
            " covariance for all candidates)"
        )
    print("\n".join([*lines, f"  Checked: {checks}."]))


def main() -> None:
    parser = closed_loop.parser(__doc__, "json", runs=8)
    parser.add_argument("--matcher", default="pmht-paper")
    arguments = parser.parse_args()
    result = measure(arguments.runs, arguments.matcher)
    if arguments.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)


if __name__ == "__main__":
    main()
