"""Alignment by grade of the IMU: how long it takes until the heading is known to 1 mrad, against a
linear covariance analysis of the same model.

    python benchmarks/alignment.py [--runs 8] [--quick] [--page docs/evidence/alignment.md]

At rest, on the move with satellites and on the move with an odometer. Times are when the filter's
1-sigma falls below 1 mrad, errors and NEES are those at the end, over all runs."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import closed_loop  # first: it asks NumPy for one thread
import numpy as np

from isogal.arrays import Array
from isogal.evaluation.bound import condition
from isogal.evaluation.ins_error_model import divide, transitions
from isogal.fusion.alignment import COARSE, SHORTEST, UNKNOWN, Alignment
from isogal.fusion.assumed import filter_model
from isogal.fusion.coarse import UNKNOWN_TILT, north_sigma
from isogal.fusion.measurements import AtRest
from isogal.fusion.measurements.rest import sensed_at_rest
from isogal.fusion.model import FilterModel
from isogal.fusion.standstill import REST_SIGMA
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import matrix, multiply, to_rotation_vector
from isogal.maps.field_map import FieldMap
from isogal.montecarlo.engine import Simulation
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory

MARKS = closed_loop.marks_of(__file__)
PHONE = {
    "grade": "tactical",
    "accelerometer": {
        "bias": 0.2, "bias_instability": 0.01, "random_walk": 0.01, "scale_factor": 0.01,
        "misalignment": 1e-6,
    },
    "gyroscope": {
        "bias": "0.3 deg/s", "bias_instability": "0.01 deg/s", "random_walk": 5e-4,
        "scale_factor": 0.01, "misalignment": 0.01,
    },
}  # fmt: skip
"""Of the order of a telephone's sensors, which no grade is; the misalignment of its accelerometers
is left out, as the filter has no state for what it does in turns (with 10 mrad of it the NEES of
the attitude is 6 on the move)."""
GRADES: dict[str, dict[str, object]] = {
    name: {"grade": name} for name in ("precision", "navigation", "tactical")
} | {"phone": PHONE}
MODES = ("at rest", "satellites", "odometer")
SECONDS = {"at rest": 900.0, "satellites": 600.0, "odometer": 900.0}
AIM = 1e-3
"""rad."""
WITHIN = 13
"""States of the linear model that are not auxiliary."""
_OF_FILTER = np.array([0, 1, 3, 4, *range(6, 15)])
"""Their indices in the filter."""


def scenario_of(
    imu: dict[str, object], mode: str, latitude: float, seconds: float, seed: int
) -> Scenario:
    """Return the scenario of a row; on the move the vehicle turns by 60 to 90 deg and changes its
    speed once or twice a minute."""
    document: dict[str, object] = {
        "seed": seed,
        "imu": imu | {"rate": 20.0},  # the means of a second cost 0.8 mm/s in a turn
        "gravity": {"field": "normal"},
        "gravimeter": {"interval": 1.0},
        "initial_error": {"position": 5.0},
        "route": {"waypoints": list(_points(latitude, seconds)), "duration": seconds,
                  "turn_rate": 0.05, "acceleration": 0.5},
        "fusion": {"start": "align"},
    }  # fmt: skip
    if mode == "at rest":
        document["route"] |= {"at_rest": seconds}  # type: ignore[operator]
    elif mode == "satellites":
        document["gnss"] = {"available": [[0.0, seconds]], "velocity_sigma": 0.05}
    else:
        document["velocity"] = {"kind": "odometer"}
    return Scenario.model_validate(document)


def _points(latitude: float, seconds: float) -> Iterator[tuple[float, float, float]]:
    north = east = 0.0
    for k in range(int(seconds / 20.0) + 4):
        scale = 111e3 * math.cos(math.radians(latitude))
        yield latitude + north / 111e3, 10.0 + east / scale, 12.0 if k % 2 else 20.0
        north += 500.0 * (k % 2)
        east += 500.0 * (1 - k % 2)


@dataclass(frozen=True)
class Course:
    """How one run went."""

    sigma: Array
    """(K,) 1-sigma of the heading after each second, rad."""
    error: Array
    """(K, 3) of the attitude, rad."""
    nees: Array
    """(K,) of it, per axis; NaN before it is aligned."""
    aligned: float
    """s; NaN = it never was."""


def align(scenario: Scenario, trajectory: Trajectory, simulation: Simulation, run: int) -> Course:
    """Align one run."""
    model = filter_model(scenario)
    place = np.array([trajectory.latitude[0], trajectory.longitude[0], trajectory.height[0]])
    it = Alignment(model, place, measured=scenario.gnss.used)
    aids = simulation.measurements(run)
    count = len(trajectory)
    sigma, error, nees = np.full(count, UNKNOWN), np.zeros((count, 3)), np.full(count, np.nan)
    aligned = math.nan
    for k in range(count):
        it.imu(float(trajectory.time[k + 1]), *simulation.samples(run, k, k + 1))
        for time, one in aids.get(k + 1, ()):
            it.measure(time, one)
        sigma[k] = it.heading_sigma
        w, x, y, z = trajectory.attitude[k + 1]
        error[k] = to_rotation_vector(*multiply(*it.state.attitude, w, -x, -y, -z))
        P = it.state.covariance[6:9, 6:9]
        if not it.aligned:
            continue
        nees[k] = error[k] @ np.linalg.solve(P, error[k]) / 3.0
        if it.aligned and math.isnan(aligned):
            aligned = float(trajectory.time[k + 1])
    return Course(sigma, error, nees, aligned)


def bound(scenario: Scenario, trajectory: Trajectory) -> Array:
    """Return (K,) the heading's 1-sigma (rad) of the linear covariance analysis about the truth,
    with all attitudes possible at the start."""
    model = filter_model(scenario)
    names = [state.name for state in model.auxiliary]
    at_rest = not scenario.gnss.used and scenario.velocity.kind == "none"
    segments = divide(trajectory, scenario.steps_per_scan)
    P, first = _start(model, trajectory, at_rest)
    result = np.full(len(trajectory), UNKNOWN)
    pairs = transitions(segments, scenario.imu, model.auxiliary)
    for k, (transition, half) in enumerate(pairs):
        if at_rest and north_sigma(model, trajectory.latitude[0]) > COARSE and k + 1 >= SHORTEST:
            result[k] = math.sqrt(_rested(model, trajectory, k + 1.0)[8, 8])
            continue
        if k < first:
            continue
        P = transition @ (P + half) @ transition.T + half
        velocity, rotation = trajectory.velocity[k + 1], matrix(trajectory.attitude[k + 1])
        for row, variance in _rows(scenario, names, velocity, rotation, at_rest, len(P)):
            condition(P, row, variance)
        result[k] = min(UNKNOWN, math.sqrt(P[6, 6]))
    return result


def _rows(
    scenario: Scenario, names: list[str], velocity: Array, rotation: Array, at_rest: bool, n: int
) -> Iterator[tuple[Array, float]]:
    """Yield the derivatives (n,) of what is measured in a second, and its variance."""
    if scenario.velocity.kind != "none":
        sigma = scenario.velocity.number("sigma")
        body = rotation.T @ velocity
        for axis in (0, 1):
            row = np.zeros(n)
            row[2:4] = rotation[:2, axis]
            row[4:7] = np.cross(rotation[:, axis], velocity)
            for name, change in (
                ("velocity_scale", body), ("velocity_pitch", np.cross(body, [0.0, 1.0, 0.0])),
                ("velocity_yaw", np.cross(body, [0.0, 0.0, 1.0])),
            ):  # fmt: skip
                if name in names:
                    row[WITHIN + names.index(name)] = change[axis]
            yield row, sigma**2
    for axis in (0, 1):
        row = np.zeros(n)
        row[2 + axis] = 1.0
        if at_rest:
            yield row, REST_SIGMA**2
        elif scenario.gnss.used:
            yield row, float(scenario.gnss.velocity_sigma or 0.0) ** 2
            place = np.zeros(n)
            place[axis], slow = 1.0, f"gnss_{('north', 'east')[axis]}"
            if slow in names:
                place[WITHIN + names.index(slow)] = 1.0
            yield place, scenario.gnss.position_sigma**2


def _flat(model: FilterModel, trajectory: Trajectory) -> FilterState:
    place = np.array([trajectory.latitude[0], trajectory.longitude[0], trajectory.height[0]])
    state = FilterState.start(Estimate(place, np.zeros(3), trajectory.attitude[0]), model)
    state.covariance[6:9, 6:9] = np.diag(np.square([UNKNOWN_TILT, UNKNOWN_TILT, UNKNOWN]))
    return state


def _rested(model: FilterModel, trajectory: Trajectory, seconds: float) -> Array:
    """Return the filter's covariance after so long at rest."""
    state = _flat(model, trajectory)
    force, rate = sensed_at_rest(state.position, model)
    to_body = matrix(state.attitude).T
    AtRest(to_body @ force, to_body @ rate, seconds).update(state, model)
    state.covariance[3:6, 3:6] = np.eye(3) * REST_SIGMA**2
    return state.covariance


def _start(model: FilterModel, trajectory: Trajectory, at_rest: bool) -> tuple[Array, int]:
    """Return the first covariance of the linear model, and the second that it is of."""
    if at_rest:
        whole = _rested(model, trajectory, SHORTEST)
    else:
        whole = _flat(model, trajectory).covariance
        whole[3:6, 3:6] = np.eye(3) * 100.0**2
    kept = np.array([*_OF_FILTER, *range(15, len(whole))])
    return whole[np.ix_(kept, kept)], round(SHORTEST) if at_rest else 0


def first_below(sigma: Array, limit: float) -> float:
    """Return after how many seconds a 1-sigma is below a limit; NaN = never."""
    below = np.flatnonzero(sigma <= limit)
    return float(below[0] + 1) if len(below) else math.nan


def row_of(grade: str, mode: str, latitude: float, runs: int, seed: int) -> str:
    """Return one line of the table."""
    scenario = scenario_of(GRADES[grade], mode, latitude, SECONDS[mode], seed)
    trajectory = build_trajectory(scenario)
    simulation = Simulation(scenario, range(runs), trajectory, _nothing(trajectory))
    best = bound(scenario, trajectory)
    courses = [align(scenario, trajectory, simulation, run) for run in range(runs)]
    north = north_sigma(filter_model(scenario), trajectory.latitude[0])
    times = [first_below(course.sigma, AIM) for course in courses]
    heading = np.array([course.error[-1, 2] for course in courses])
    end = np.array([course.sigma[-1] for course in courses])
    nees = np.mean([course.nees[-1] for course in courses])
    of_heading = np.mean(heading**2 / end**2) if np.isfinite(nees) else np.nan
    aligned = [course.aligned for course in courses]
    return (
        f"| {grade} | {mode} | {latitude:g} | {_angle(north)} | {_seconds(aligned)} |"
        f" {_seconds(times)} | {_seconds([first_below(best, AIM)])} | {_angle(np.median(end))} |"
        f" {_angle(best[-1])} | {_angle(math.sqrt(np.mean(heading**2)))} | {_number(nees)} |"
        f" {_number(of_heading)} |"
    )


def _nothing(trajectory: Trajectory) -> FieldMap:
    """Return a map without relief around the start: nothing is matched."""
    latitude = trajectory.latitude[0] + np.linspace(-0.01, 0.01, 41)
    longitude = trajectory.longitude[0] + np.linspace(-0.1, 0.1, 41)
    return FieldMap(latitude, longitude, np.zeros((41, 41)), "m/s²", "gravity")


def _seconds(times: list[float]) -> str:
    known = [time for time in times if math.isfinite(time)]
    if len(known) < 0.5 * len(times):
        return "never"
    return f"{np.median(np.where(np.isfinite(times), times, np.inf)):.0f} s"


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "–"


def _angle(size: float) -> str:
    return f"{1e3 * size:.2g} mrad" if size < 0.1 else f"{math.degrees(min(size, UNKNOWN)):.0f}°"


HEAD = closed_loop.head_of(
    [
        *("IMU", "how", "latitude", "gyroscopes find north to", "aligned", "1 mrad"),
        *("bound of it", "1-sigma at the end", "bound of it", "RMS error"),
        *("NEES of attitude", "of heading"),
    ]
)


def main() -> None:
    """Write the table."""
    parser = closed_loop.parser(__doc__, "page", runs=8)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--quick", action="store_true", help="latitude 45 and 4 runs")
    parser.add_argument("--modes", nargs="*", default=list(MODES), choices=MODES)
    parser.add_argument("--grades", nargs="*", default=list(GRADES), choices=list(GRADES))
    options = parser.parse_args()
    runs = 4 if options.quick else options.runs
    lines = [HEAD]
    print(HEAD, flush=True)
    for mode in options.modes:
        for grade in options.grades:
            for latitude in (45.0,) if options.quick else (0.0, 60.0, 80.0):
                lines.append(row_of(grade, mode, latitude, runs, options.seed))
                print(lines[-1], flush=True)
    text = f"{runs} runs a row.\n\n" + "\n".join(lines)
    closed_loop.write_between(options.page, MARKS, text, seed=options.seed)


if __name__ == "__main__":
    main()
