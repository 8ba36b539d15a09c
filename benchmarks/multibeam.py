"""An underwater vehicle over a made-up sea floor: one beam against several, with a tide that is an
unknown offset and a speed of sound that is an unknown scale (docs/mathematics.md, section 2.7).

    python benchmarks/multibeam.py [--runs 24] [--out DIR]
"""

import argparse
import json
from pathlib import Path

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.consistency import nees_per_axis
from isogal.fields.scenario_map import map_for_scenario
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

ORIGIN = (60.0, 5.0)
"""deg."""
_HALF, _STEP, _DEPTH = 6e3, 40.0, 300.0
SCENARIO = (
    "field=terrain",
    "route.waypoints=[[59.985,4.96,2.0],[60.0,5.0,2.0],[59.99,5.03,2.0]]",
    "route.height=-200",
    "route.duration=2300",
    "route.turn_rate=0.03",
    "gravity.field=normal",
    "imu.grade=navigation",
    "initial_error.position=200",
    "gravimeter.sigma=0.5",
    "gravimeter.interval=20",
    "gravimeter.bias=2",
    "map_error.sigma=1",
    "map_error.correlation_length=100",
    "matcher.map_sigma=1",
    "matcher.map_correlation_length=100",
    "matcher.bias_sigma=2",
    "matcher.batch_length=12",
)
DVL = "altimeter.directions=[[45,30],[135,30],[225,30],[315,30]]"
SCALE = "truth.altimeter.scale_sigma=0.01"
FAN = ("altimeter.beams=8", "altimeter.opening=120")
CASES = {
    "one beam": ("matcher.batch_length=30",),
    "four beams of a Doppler log, 30° from straight down": (DVL,),
    "fan of 8 beams over 120°": FAN,
    "four beams, speed of sound wrong by 1 %, estimated": (DVL, "altimeter.scale_sigma=0.01"),
    "8 beams, the same": (*FAN, "altimeter.scale_sigma=0.01"),
    "8 beams, the same, neither told nor estimated": (*FAN, SCALE),
}


def sea_floor() -> FieldMap:
    """Return a floor around 300 m below the surface: waves of 0.3 to 4 km, 13 m RMS."""
    side = np.arange(-_HALF, _HALF + _STEP / 2, _STEP)
    waves = np.random.default_rng(15)
    values = np.full((side.size, side.size), -_DEPTH)
    for length in np.geomspace(300.0, 4000.0, 30):
        direction, phase = waves.uniform(0.0, 2.0 * np.pi, 2)
        along = side[:, None] * np.cos(direction) + side * np.sin(direction)
        values += 4e-3 * length**0.9 * np.sin(2.0 * np.pi * along / length + phase)
    north, east = metres_per_radian(np.radians(ORIGIN[0]))
    axes = np.radians(ORIGIN[0]) + side / north, np.radians(ORIGIN[1]) + side / east
    return FieldMap(*axes, values, "m", "height", provenance="made-up sea floor")


def study(scenario: Scenario, runs: int) -> dict[str, float]:
    """Return the position's errors of a case: RMS of all scans (m), NEES, and the bound."""
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    found = simulate(scenario, range(runs), field_map)
    bound = posterior_cramer_rao(scenario, trajectory, field_map, batchwise=True)
    settled = found.time > 600.0
    error = found.error[:, settled]
    return {
        "rms": float(np.sqrt((error**2).sum(axis=-1).mean())),
        "nees": float(np.mean(nees_per_axis(error, found.covariance[:, settled]))),
        "bound": float(np.sqrt((bound.rms_at(found.time[settled]) ** 2).mean())),
        "fixes": float(np.isfinite(found.fix_error[..., 0]).mean()),
        "fix_ms": float(1e3 * np.nanmedian(found.fix_seconds)),
    }


def main() -> None:
    """Run all cases and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--out", type=Path, default=Path("out/multibeam"))
    parser.add_argument("--case", action="append", help="of the table, by its beginning")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "sea_floor.nc"
    write_netcdf(sea_floor(), path)
    table = {}
    print("case | RMS (m) | NEES per axis | bound (m) | RMS / bound | fixes | ms per fix")
    for name, keys in CASES.items():
        if arguments.case and not any(name.startswith(one) for one in arguments.case):
            continue
        scenario = load_scenario(None, [*SCENARIO, f"map.source={path}", *keys])
        table[name] = one = study(scenario, arguments.runs)
        print(
            f"{name} | {one['rms']:.2f} | {one['nees']:.2f} | {one['bound']:.2f}"
            f" | {one['rms'] / one['bound']:.2f} | {one['fixes']:.0%} | {one['fix_ms']:.0f}",
            flush=True,
        )
    (arguments.out / "results.json").write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
