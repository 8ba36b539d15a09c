"""CPU time of a fix and of an hour of a run, stage by stage.

    python benchmarks/stages.py --data DIR [--untold] [--runs 4] [--hours 3.6]

DIR holds `se_australia_gravity.nc`; the map is 3 mGal wrong, which the matcher is told, or with
`--untold` is not (`matcher.map_sigma=auto`). Times are CPU times of this thread, each stage
without those that it calls. On a machine that does other work besides, compare two versions by
turns: times of both then grow alike."""

from types import ModuleType

import closed_loop
import numpy as np
from clock import Clock

from isogal import navigator
from isogal.fusion import inertial_navigator
from isogal.matching import joint_batches
from isogal.matching.pmht import diverged, matcher, mixture_kernels
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.montecarlo import engine, recorder
from isogal.scenario import load_scenario

_own = inertial_navigator.InertialNavigator
MATCHER = "the matcher's rest"
STAGES: tuple[tuple[str, ModuleType | type, str], ...] = (
    ("hypotheses carried along", Hypotheses, "carried"),
    ("rows", matcher, "rows_of"),
    ("split: looks at the map", mixture_kernels, "curvature"),
    ("split: rest", Hypotheses, "split"),
    ("readings taken", Hypotheses, "observed"),
    ("merged", Hypotheses, "reduced"),
    ("search: cells", diverged, "_ranked"),
    ("search: rest", matcher, "pursued"),
    ("publish", matcher, "published"),
    (MATCHER, matcher.Pmht, "match"),
    ("batch built", joint_batches.JointBatches, "build"),
    ("batch corrected", joint_batches.JointBatches, "correct"),
    ("fix applied", _own, "measure_all"),
    ("strapdown and filter", _own, "imu"),
    ("readings", navigator.Navigator, "read"),
    ("record", recorder.Recorder, "write_track"),
    ("sensors and unaided INS", engine.Simulation, "__init__"),
    ("rest of the engine", engine, "simulate"),
)
"""Name, and where the function is looked up."""


def measure(settings: list[str], runs: int, hours: float) -> None:
    """Print the stages of a scenario's runs."""
    short = load_scenario(None, [*settings, "route.duration=1500"])
    scenario = load_scenario(None, [*settings, f"route.duration={hours * 3600.0}"])
    engine.simulate(short, [0])  # compiles
    clock = Clock()
    for stage in STAGES:
        clock.watch(*stage)
    engine.simulate(scenario, range(runs))
    total = sum(clock.seconds.values())
    fixes = 1e3 * np.array(clock.calls[MATCHER])
    print(f"{runs * hours / total:.2f} run-hours per CPU second")
    print(
        f"a fix: median {np.median(fixes):.2f} ms, mean {np.mean(fixes):.2f} ms,"
        f" 99 % {np.percentile(fixes, 99.0):.2f} ms, longest {fixes.max():.2f} ms"
    )
    for name, seconds in sorted(clock.seconds.items(), key=lambda item: -item[1]):
        print(f"{1e3 * seconds / len(fixes):8.3f} ms  {name}")


def main() -> None:
    """Measure and print."""
    parser = closed_loop.parser(__doc__, "data", runs=4)
    parser.add_argument("--untold", action="store_true", help="the matcher is told nothing")
    parser.add_argument("--hours", type=float, default=3.6)
    options = parser.parse_args()
    settings = [
        f"map.source={options.data}/se_australia_gravity.nc",
        "matcher.stride=5",
        "gravity.field=normal",
        "map_error.sigma=3e-5",
        f"matcher.map_sigma={'auto' if options.untold else 3e-5}",
    ]
    measure(settings, options.runs, options.hours)


if __name__ == "__main__":
    main()
