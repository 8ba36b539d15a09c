"""The same voyages by the samples of an INS's sensors, and by nothing but its solution.

    python benchmarks/black_box.py --out DIR [--runs 8] [--workers 2] [--duration 9000]
        [--rows TEXT ...] [--page docs/evidence/black-box.md]

A vehicle turns at every corner of a zigzag, on the synthetic map. Each row has the same random
numbers as the one by the IMU above it: the ratio of both RMS errors after the first hour is what
the way through the solution costs. Runs that are in `--out` are not computed again; after a change
of the library, begin with an empty folder."""

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

import closed_loop

from isogal.files import write_atomic
from isogal.scenario import Scenario, validate_scenario

MARKS = closed_loop.marks_of(__file__)
DIGITS = {"position_resolution": 0.01, "velocity_resolution": 0.01, "angle_resolution": 1.745e-4}
"""1 cm (1e-7 deg), 1 cm/s, 0.01 deg: of text that an INS sends."""
WAYS: dict[str, dict[str, object]] = {
    "its IMU": {},
    "its solution": {"source": "solution"},
    "with last digits": {"source": "solution", **DIGITS},
    "without attitude": {"source": "solution", "attitude": False},
    "without attitude, with last digits": {"source": "solution", "attitude": False, **DIGITS},
}
SHIP = {"speed": 22.0, "turn_rate": 0.02, "leg": 20e3}
AIRCRAFT = {"speed": 70.0, "turn_rate": 0.05, "leg": 40e3}
WORLDS: dict[str, dict[str, object]] = {
    "precision, 1 Hz": SHIP,
    "quantum, 1 Hz": SHIP | {"imu": {"grade": "quantum"}},
    "navigation, 1 Hz": SHIP | {"imu": {"grade": "navigation"}},
    "precision, 1 Hz, aircraft": AIRCRAFT,
    "precision, 4 Hz": SHIP | {"imu": {"rate": 4.0}},
    "precision, IMU of 20 Hz, solution of 1 Hz": SHIP
    | {"imu": {"rate": 20.0}, "fusion": {"rate": 1.0}},
}
HEAD = ("INS", "by", "RMS, m", "of the IMU's", "over bound", "unaided, m", "NEES")


def scenario_of(world: dict[str, object], ins: dict[str, object], duration: float) -> Scenario:
    """Return the scenario of a row: a zigzag to the north-east."""
    keys = dict(world)
    speed, turn_rate, leg = (float(str(keys.pop(key))) for key in ("speed", "turn_rate", "leg"))
    corners = 2 * int(speed * duration / leg) + 5
    step = leg / 111e3
    waypoints = [
        [-38.0 + step * 0.5 * (k + 0.8 * (k % 2)), 144.5 + step * (k // 2 + 0.5 * (k % 2)), speed]
        for k in range(corners)
    ]
    route = {"waypoints": waypoints, "turn_rate": turn_rate, "duration": duration}
    return validate_scenario({"route": route, "ins": ins, **keys})


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute the rows, print the table, and write it into a page."""
    names = "out", "workers", "page", "rows"
    parser = closed_loop.parser(__doc__, *names, runs=8, duration=9000.0)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    results, rows = {}, []
    print(closed_loop.head_of(HEAD), flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for name, world in WORLDS.items():
            if not closed_loop.containing(name, options.rows):
                continue
            for way, ins in WAYS.items():
                scenario = scenario_of(world, ins, options.duration)
                record = closed_loop.kept_runs(scenario, options.runs, options.out, pool)
                bound = closed_loop.bound_of(scenario, record)
                found = closed_loop.figures_of(scenario, record, bound)
                results[f"{name}, {way}"] = found
                ratio = found["rms"] / results[f"{name}, its IMU"]["rms"]
                rows.append(
                    [
                        *(name, way, f"{found['rms']:.1f}", f"{ratio:.3f}"),
                        *(f"{found['ratio']:.2f}", f"{found['unaided']:.0f}"),
                        f"{found['nees_settled']:.2f}",
                    ]
                )
                print(closed_loop.line_of(rows[-1]), flush=True)
    text = f"{options.runs} runs of {options.duration:.0f} s; after the first hour."
    text += f"\n\n{closed_loop.markdown(HEAD, rows)}"
    write_atomic(options.out / "black_box.json", json.dumps(results, indent=1))
    closed_loop.write_between(options.page, MARKS, text)


if __name__ == "__main__":
    main()
