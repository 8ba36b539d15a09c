"""Runs whose results are kept, so that a change that must not change any result can be seen to
have changed none.

    export PYTHONPATH=tests
    python -m helpers.reference_runs write FILE.npz      every number, to compare on one machine
    python -m helpers.reference_runs compare FILE.npz    the largest difference of each case, m
    python -m helpers.reference_runs keep                tests/regression/results.json, for a test

An hour of one run each, of graphs ten minutes, on maps that are made up here. What is
compared: the navigator's error and its 1-sigma at every scan, the fixes, their errors and
1-sigmas; m."""

import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.records import Runs
from isogal.montecarlo.engine import simulate
from isogal.scenario import Matcher, Scenario, load_scenario
from isogal.tracks.matching import Uncertainty, match_track

KEPT = Path(__file__).parents[1] / "regression" / "results.json"
Results = dict[str, np.ndarray]

_DEGREES = tuple(float(x) for x in np.degrees(ORIGIN))
_ROUTE = [
    f"route.start=[{_DEGREES[0] - 0.24}, {_DEGREES[1] - 0.28}]",
    f"route.end=[{_DEGREES[0] + 0.3}, {_DEGREES[1] + 0.35}]",
    "route.speed=18.0",
    "route.duration=3600.0",
    "gravimeter.quantity=disturbance",
    "map.continuation=none",
    "gravity.field=normal",
]
"""Over the made-up maps."""
_HOUR = ["route.duration=3600.0", "map.continuation=none", "gravity.field=normal"]
"""Over the synthetic map."""
_WRONG = ["map_error.sigma=3e-5"]
_TOLD = [*_WRONG, "matcher.map_sigma=3e-5"]
MATCHERS = ("pmht", "pmht-paper", "tercom", "iccp", "sitan", "particle", "point-mass", "viterbi")
ENGINE: dict[str, list[str]] = (
    {name: [*_HOUR, f"matcher.name={name}"] for name in MATCHERS}
    | {
        f"{name} retrodiction": [*_HOUR, f"matcher.name={name}", "matcher.mode=retrodiction"]
        for name in MATCHERS
    }
    | {
        "disturbance": [*_HOUR, "gravimeter.quantity=disturbance", "gravimeter.sigma=1e-6"],
        "noisy": [*_HOUR, "gravimeter.sigma=2e-4"],
        "3 mGal": [*_HOUR, *_TOLD],
        "8 mGal, T 15": [
            *_HOUR, "gravimeter.quantity=disturbance", "gravimeter.sigma=1e-6",
            "map_error.sigma=8e-5", "matcher.map_sigma=8e-5", "matcher.batch_length=15",
        ],
        "stride 5": [*_HOUR, *_TOLD, "matcher.stride=5"],
        "nothing told": [*_HOUR, *_WRONG, "matcher.map_sigma=auto", "matcher.stride=5"],
        "auto": [*_HOUR, *_WRONG, "matcher.map_sigma=auto"],
        "bias": [
            *_HOUR, *_TOLD, "gravimeter.bias=5e-5", "gravimeter.drift=2.8e-9",
            "matcher.bias_sigma=5e-5",
        ],
        "bias untold": [*_HOUR, "gravimeter.bias=5e-5", "gravimeter.drift=2.8e-9"],
        "outliers": [*_HOUR, "gravimeter.outlier_fraction=0.05"],
        "wide start": [*_HOUR, "initial_error.position=10000"],
        "hidden start": [*_HOUR, "initial_error.hidden_position=10000"],
        "hidden start, 3 mGal": [*_HOUR, *_TOLD, "initial_error.hidden_position=10000"],
        "terrain": [*_HOUR, "field=terrain", "gravimeter.sigma=5", "route.height=4500"],
        "gradient": [*_HOUR, "field=gradient"],
        "turns": [
            *_HOUR,
            "route.waypoints=[[-37.9, 144.8, 22], [-37.75, 145.0, 18], [-37.8, 145.3, 25], "
            "[-37.4, 145.5, 22]]",
        ],
    }
)  # fmt: skip


def _of(runs: Runs) -> Results:
    sigma, fix_sigma = (
        np.sqrt(np.diagonal(array, axis1=-2, axis2=-1))
        for array in (runs.covariance, runs.fix_covariance)
    )
    return {
        "error": runs.error[0],
        "sigma": sigma[0],
        "fix_error": runs.fix_error[0],
        "fix_sigma": fix_sigma[0],
    }


def _engine(case: str) -> Results:
    return _of(simulate(_scenario(ENGINE[case]), [0]))


def _scenario(settings: list[str]) -> Scenario:
    """Return the scenario in which batches do not overlap and the map is exact, unless it is said
    that they do and it is not."""
    said = dict(item.split("=", 1) for item in settings)
    length = said.get("matcher.batch_length", "30")
    usual = {"matcher.stride": length, "matcher.map_sigma": "0"}
    more = [f"{key}={value}" for key, value in usual.items() if key not in said]
    return load_scenario(None, [*settings, *more])


def _magnetic() -> Results:
    settings = [
        *_ROUTE[:4],
        "map.continuation=none",
        "gravity.field=normal",
        "field=magnetic",
        "gravimeter.sigma=2.0",
        "route.height=300.0",
    ]
    return _of(simulate(_scenario(settings), [0], field_of("magnetic_anomaly")))


def _uneven() -> Results:
    """A map that says how wrong it is, and where."""
    rough = field_map_of(wavy, step=500.0)
    north, east = rough.value_and_gradient(
        *np.meshgrid(rough.latitude, rough.longitude, indexing="ij")
    )[1:]
    uneven = replace(
        rough, sigma=np.nan_to_num(300.0 * np.hypot(north, east)) + 5e-6, correlation_length=3000.0
    )
    return _of(simulate(_scenario([*_ROUTE, "map_error.sigma=1e-5"]), [0], uneven))


def _track(
    matcher: str, uneven: bool = False, chained: bool = False, **settings: object
) -> Results:
    field = field_of("magnetic_anomaly", correlation_length=3000.0)
    if uneven:
        north, east = field.value_and_gradient(
            *np.meshgrid(field.latitude, field.longitude, indexing="ij")
        )[1:]
        field = replace(field, sigma=np.nan_to_num(200.0 * np.hypot(north, east)) + 5.0)
    track, *_ = made_track(field, count=150, error=(700.0, -900.0), sigma=2.0, seed=4)
    rough = 12.0 * np.sin(np.arange(150) / 6.0)
    moved = Matcher.model_validate(
        {"name": matcher, "map_sigma": 10.0, "batch_length": 30, **settings}
    )
    matches = match_track(
        replace(track, value=track.value + rough),
        field,
        moved,
        Uncertainty(1500.0, 0.1, 50.0),
        chained=chained,
    )
    north, east = metres_per_radian(ORIGIN[0])
    places = np.array(
        [(m.fix.latitude, m.fix.longitude) if m.fix.published else (np.nan,) * 2 for m in matches]
    )
    return {
        "error": np.array([m.error[:2] for m in matches]),
        "sigma": np.array([np.sqrt(np.diag(m.covariance))[:2] for m in matches]),
        "fix_error": (places - ORIGIN) * (north, east),
        "fix_sigma": np.array([np.sqrt(np.diag(m.fix.covariance)) for m in matches]),
    }


def _graph(*changes: str, seconds: float = 620.0) -> Results:
    """Return those of two batches: what more batches do, the engine's cases say."""
    from helpers.node_bench import run_here
    from helpers.recordings import record

    with tempfile.TemporaryDirectory() as folder:
        from isogal.maps.formats.netcdf_writing import write_netcdf

        source = Path(folder) / "wavy.nc"
        write_netcdf(field_map_of(wavy, step=500.0), source)
        base = [*_ROUTE, f"map.source={source}"]
        scenario = _scenario([*base, f"route.duration={seconds}", *changes])
        return _in_domain(
            lambda: _of(record(_ran(run_here, scenario, Path(folder) / "bag"), scenario))
        )


def _ran(run: Callable[[Scenario, Path], object], scenario: Scenario, bag: Path) -> Path:
    run(scenario, bag)
    return bag


def _in_domain(work: Callable[[], Results]) -> Results:
    import os

    from isogal_ros.graph.domain import DOMAIN, claim_domain

    with claim_domain() as number:
        before = os.environ.get(DOMAIN)
        os.environ[DOMAIN] = str(number)
        try:
            return work()
        finally:
            os.environ.pop(DOMAIN) if before is None else os.environ.update({DOMAIN: before})


LIBRARY: dict[str, Callable[[], Results]] = (
    {f"engine: {case}": lambda case=case: _engine(case) for case in ENGINE}
    | {"engine: magnetic": _magnetic, "engine: uneven map error": _uneven}
    | {f"match: {name}": lambda name=name: _track(name) for name in MATCHERS}
    | {
        "match: chained": lambda: _track("pmht", chained=True),
        "match: auto": lambda: _track("pmht", map_sigma="auto"),
        "match: uneven map error": lambda: _track("pmht", uneven=True),
        "match: bias": lambda: _track("pmht", bias_sigma=20.0),
        "match: stride 10": lambda: _track("pmht", stride=10),
    }
)
GRAPH: dict[str, Callable[[], Results]] = {
    "graph: pmht-paper retrodiction": lambda: _graph(
        "matcher.name=pmht-paper", "matcher.mode=retrodiction"
    ),
    "graph: hidden start, auto": lambda: _graph(
        "matcher.map_sigma=auto", "initial_error.hidden_position=6000", seconds=1800.0
    ),
}


def sampled(results: Results) -> dict[str, list[list[float | None]]]:
    """Return what the test keeps: every tenth scan of long arrays, to 1e-6 m."""
    return {
        name: [[None if np.isnan(x) else round(float(x), 6) for x in row] for row in _thin(array)]
        for name, array in results.items()
    }


def _thin(array: np.ndarray) -> np.ndarray:
    return array if len(array) < 80 else array[::30]


def difference(now: Results, before: Results) -> float:
    """Return the largest difference, m; infinite where there is a fix in one and none in the
    other."""
    worst = 0.0
    for name, array in before.items():
        if now[name].shape != array.shape or (np.isnan(now[name]) != np.isnan(array)).any():
            return float("inf")
        worst = max(worst, float(np.nanmax(np.abs(now[name] - array), initial=0.0)))
    return worst


def main() -> int:
    command, *rest = sys.argv[1:]
    chosen = LIBRARY | GRAPH
    if command == "keep":
        KEPT.parent.mkdir(exist_ok=True)
        kept = json.loads(KEPT.read_text())
        lines = [
            f"{json.dumps(name)}: {json.dumps(sampled(make()))}"
            for name, make in chosen.items()
            if name in kept
        ]
        KEPT.write_text("{\n" + ",\n".join(lines) + "\n}\n")
        return 0
    if command == "write":
        made = {
            f"{case}|{name}": array
            for case, make in chosen.items()
            for name, array in make().items()
        }
        np.savez(rest[0], **made)
        return 0
    stored = np.load(rest[0])
    bad = 0
    for case, make in chosen.items():
        if len(rest) > 1 and not any(word in case for word in rest[1:]):
            continue
        before = {
            key.partition("|")[2]: stored[key]
            for key in stored.files
            if key.partition("|")[0] == case
        }
        apart = difference(make(), before)
        bad += not apart <= 1e-9
        print(f"{case}: {apart:.3g} m", flush=True)
    print(f"{bad} cases differ by more than 1e-9 m")
    return bad != 0


if __name__ == "__main__":
    sys.exit(main())
