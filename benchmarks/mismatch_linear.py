"""What an estimator with every effect of a told row of `mismatch.py` as a state makes of the same
runs.

    python benchmarks/mismatch_linear.py --data DIR --out DIR [--runs 100] [--rows TEXT ...]
        [--page docs/evidence/wrong-assumptions.md]

`--out` is the folder of `mismatch.py`, whose runs are taken from there. The estimator is the
Kalman filter whose covariance is the bound (docs/mathematics.md, section 11.1), given every
reading at once, with the errors of the very readings and inertial data of those runs. It is
linearised at the truth, which nobody knows. Where it does no better than its bound, or is no more
consistent, in these runs, neither can a matcher. Rows with aids of height or velocity, or readings
of several channels, are left out."""

import argparse
from dataclasses import replace
from pathlib import Path

import closed_loop
import numpy as np
from closed_loop import jackknife
from mismatch import changed, map_share, scenario_of
from mismatch_maps import coarse_map
from mismatch_rows import MGAL_3, ROWS, Row

from isogal.arrays import Array
from isogal.evaluation.bound import BoundModel, bound_model, condition, posterior_cramer_rao
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario, true_map
from isogal.fields.simulator import ReadingSimulator, scan_index, true_readings
from isogal.scenario import Scenario
from isogal.sensors.lag import Lag
from isogal.sensors.platform import mean_error
from isogal.sensors.trajectory import Trajectory, build_trajectory

MARKS = closed_loop.marks_of(__file__, "<!-- end of the linear table -->")
HEAD = (
    *("what differs, specified", "runs", "bound (m)", "linear (m)", "its NEES"),
    *("`pmht` (m)", "`pmht` / linear"),
)


def kalman(model: BoundModel, difference: Array) -> tuple[Array, Array]:
    """Return the estimates (R, S + 1, 2) of the north and east error of R navigators, and their
    covariance (S + 1, 2, 2), from the differences (R, S) of reading and map; NaN = no reading,
    in all runs alike."""
    readings, P = model.measurements[-1], model.start.copy()
    x, scans = np.zeros((len(difference), len(P))), difference.shape[1]
    estimate, covariance = np.zeros((len(x), scans + 1, 2)), np.zeros((scans + 1, 2, 2))
    covariance[0] = P[:2, :2]
    for stretch, (transition, half) in enumerate(model.transitions(), 1):
        P = transition @ (P + half) @ transition.T + half
        x = x @ transition.T
        scan, rest = divmod(stretch, model.segments.per_scan)
        if rest:
            continue
        for row, noise in readings.at(stretch):
            if np.isfinite(difference[:, scan - 1]).all():
                gain = condition(P, row, noise)
                x += np.outer(difference[:, scan - 1] - x @ row, gain)
        estimate[:, scan], covariance[scan] = x[:, :2], P[:2, :2]
    return estimate, covariance


def differences(
    scenario: Scenario, trajectory: Trajectory, record: Runs, model: BoundModel
) -> Array:
    """Return (R, S) what each reading is beside the map at the place of the unaided INS, linear
    about the truth: by that INS's error, and the reading's own."""
    field_map = map_for_scenario(scenario, trajectory)
    world, field = scenario.true, measured_field(scenario)
    source, index = true_map(scenario, trajectory, field_map), scan_index(scenario, trajectory)
    felt = ReadingSimulator(world, trajectory, source, range(len(record))).raw
    lag = Lag.of(world.gravimeter)
    if lag.mean > 0.0:
        every = np.arange(len(trajectory) + 1)
        perfect = true_readings(world, trajectory, source, every)
        perfect = lag.report(trajectory.time, perfect, trajectory.time[index])
    else:
        perfect = true_readings(world, trajectory, source)
    place = trajectory.latitude[index], trajectory.longitude[index]
    error = field.sign * (felt - perfect) - mean_error(world.gravimeter)
    error += source.value(*place) - field_map.value(*place)
    position = record.unaided_error
    velocity = np.gradient(position, record.time, axis=1)
    state = np.concatenate([position, velocity], axis=2)[:, 1:]
    return np.einsum("si,rsi->rs", model.measurements[-1].rows[:, 0, :4], state) + error


def line_of(row: Row, options: argparse.Namespace) -> str | None:
    """Return the line of a told row; None where it is left out or has not been run."""
    maps = coarse_map(options.data, options.out)
    scenario = scenario_of(row, "told", MGAL_3, maps)
    parts = [
        path for _, path in closed_loop.parts_of(scenario, options.runs, options.out / "parts")
    ]
    aided = scenario.height.measured or scenario.velocity.kind != "none"
    several = measured_field(scenario).channels is not None
    if aided or several or not all(path.exists() for path in parts):
        return None
    record = Runs.concatenate([Runs.load(path) for path in parts])
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    world = changed(scenario.informed, maps.put_in(row.bound)) if row.bound else scenario.informed
    share = map_share(world, field_map, record)
    model = bound_model(world, trajectory, field_map, map_share=share)
    error, covariance = one_by_one(world, differences(scenario, trajectory, record, model), model)
    error = record.unaided_error - error
    late = record.elapsed > SETTLED_AFTER
    nees = np.einsum(
        "rki,rkij,rkj->rk", error[:, late], np.linalg.inv(covariance[:, late]), error[:, late]
    )
    bound = posterior_cramer_rao(world, trajectory, field_map, map_share=share).rms_at(record.time)
    of_run = (error[:, late] ** 2).sum(axis=2).mean(axis=1)
    of_pmht = (record.horizontal_error[:, late] ** 2).mean(axis=1)
    linear, pmht, limit = (np.sqrt(one.mean()) for one in (of_run, of_pmht, bound[late] ** 2))
    pair, spread = jackknife(lambda a, b: float(np.sqrt(a.mean() / b.mean())), of_pmht, of_run)
    numbers = f"{limit:.1f}", f"{linear:.1f}", f"{nees.mean() / 2.0:.2f}", f"{pmht:.1f}"
    return closed_loop.line_of(
        [row.name, str(len(record)), *numbers, f"{pair:.3f} ± {spread:.3f}"]
    )


def one_by_one(world: Scenario, difference: Array, model: BoundModel) -> tuple[Array, Array]:
    """Return `kalman`'s estimates and covariances (R, S + 1, 2, 2), run by run where each misses
    other readings, of which the model's noise is a mean."""
    share = world.gravimeter.missing_fraction
    if share == 0.0:
        estimate, covariance = kalman(model, difference)
        return estimate, np.broadcast_to(covariance, (len(difference), *covariance.shape))
    *aids, readings = model.measurements
    given = replace(readings, noise=readings.noise * (1.0 - share))
    each_given = replace(model, measurements=(*aids, given))
    runs = [kalman(each_given, one[None]) for one in difference]
    return np.concatenate([one for one, _ in runs]), np.stack([one for _, one in runs])


def main() -> None:
    """Compute and print."""
    out = Path("out/mismatch")
    options = closed_loop.parser(__doc__, "data", "rows", "page", out=out, runs=100).parse_args()
    lines = [closed_loop.head_of(HEAD)]
    for row in ROWS:
        chosen = row.tellable and closed_loop.containing(row.name, options.rows)
        if chosen and (line := line_of(row, options)):
            lines.append(line)
            print(line, flush=True)
    closed_loop.write_between(options.page, MARKS, "\n".join(lines))


if __name__ == "__main__":
    main()
