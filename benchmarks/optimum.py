"""How far Isogal's fixes are from the exact posterior of the same runs: docs/evidence/optimum.md.

    python benchmarks/optimum.py --data ../shared/data [--runs 4] [--seed 271828]
        [--particles 600] [--rows TEXT ...] [--only RUN ...] [--set KEY=VALUE ...] [--workers 2]
        [--page FILE]

The runs are those of `isogal.montecarlo.engine.simulate`: same truth, same IMU data, same readings
up to each fix. The reference knows the size of all errors as they are simulated, the map's among
them. It is a mixture of Gaussians over the linear error model of docs/mathematics.md, sections 3.2
and 11.1, about the true trajectory; only the map's value is not linear, and it depends on the
horizontal position alone. So the position is sampled (Rao-Blackwellised particles; Doucet, de
Freitas, Murphy & Russell 2000) as far as a Gaussian would be too wide for the map: where a
particle's own position covariance exceeds `width`² of that of all particles in a direction, part
of it is drawn, and the rest of the state follows by regression, until it does not. What remains is
Gaussian, and each particle has its own Kalman filter.

Two references with independent random numbers and particles of different widths show by their
difference how exact they are; the products of the differences from both have no bias by their
randomness. Neither the filter nor a matcher of Isogal is used."""

import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import closed_loop
import numpy as np
from acceptance_rows import Place, of_the_readme

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.bound import BoundModel, bound_model
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.results import write_json
from isogal.fields.gravity_vector import gravity_vector, sensed_gravity
from isogal.fields.known_gravity import RESOLUTION_SIGMA
from isogal.fields.scenario_map import maps_for_scenario, true_map
from isogal.fields.simulator import ReadingSimulator, scan_index, true_readings
from isogal.inertial.strapdown import propagate
from isogal.maps.tiled_map import ScalarMap
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal.scenario.loading import changed_scenario
from isogal.seeds import generator
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import Trajectory, build_trajectory

WIDTHS = 0.7, 0.5
"""Of a particle's own position in units of that of all, for the two references."""


@dataclass(frozen=True)
class Model:
    """The linear model from scan to scan: S scans, n states, the first four of which are the
    errors of position (m) and velocity (m/s) to the north and east."""

    start: Array
    """(n, n) covariance."""
    transition: Array
    """(S, n, n)"""
    noise: Array
    """(S, n, n) covariance that comes in on the way to a scan."""
    by_state: Array
    """(S, n) derivative of a reading less the map's value, without the map's gradient."""
    variance: float
    """Of a reading's white noise."""
    field_map: ScalarMap
    latitude: Array
    """(S,) rad, true."""
    longitude: Array
    """(S,) rad, true."""

    def map_at(self, scan: int, moved: Array) -> tuple[Array, Array]:
        """Return how far the map's value is from that at the true place, (N,), and its gradient
        (N, 2; per m) at places off it by (N, 2) m."""
        north, east = metres_per_radian(self.latitude[scan])
        latitude = np.append(self.latitude[scan], self.latitude[scan] + moved[:, 0] / north)
        longitude = np.append(self.longitude[scan], self.longitude[scan] + moved[:, 1] / east)
        value, *gradient = self.field_map.value_and_gradient(latitude, longitude)
        return value[1:] - value[0], np.stack(gradient, axis=1)[1:]


def model_of(scenario: Scenario, trajectory: Trajectory, field_map: ScalarMap) -> Model:
    """Return the model of a scenario's runs as they are simulated."""
    linear = bound_model(scenario.true, trajectory, field_map)
    scans = scan_index(scenario, trajectory)
    rows = linear.measurements[-1].rows[:, 0].copy()
    latitude, longitude = trajectory.latitude[scans], trajectory.longitude[scans]
    _, north, east = field_map.value_and_gradient(latitude, longitude)
    rows[:, 0] += north
    rows[:, 1] += east
    start, scale = linear.start.copy(), np.ones(len(linear.start))
    for at, state in enumerate(linear.states, len(start) - len(linear.states)):
        if state.enters == "gravity":  # the simulated one has no grid of cells
            left = max(0.0, start[at, at] - RESOLUTION_SIGMA**2)
            scale[at] = np.sqrt(left / start[at, at])
    start *= np.outer(scale, scale)
    transition, noise = _by_scans(linear, scale)
    used = np.flatnonzero(np.diag(start) + np.einsum("sii->i", noise) > 0.0)
    part = np.ix_(range(len(scans)), used, used)
    return Model(
        start[np.ix_(used, used)],
        transition[part],
        noise[part],
        rows[:, used],
        scenario.true.gravimeter.sigma**2,
        field_map,
        latitude,
        longitude,
    )


def _by_scans(linear: BoundModel, scale: Array) -> tuple[Array, Array]:
    """Return transitions and noise (S, n, n) from scan to scan; the noise of states is scaled
    (n,)."""
    size, readings = len(linear.start), linear.measurements[-1]
    count, scans = readings.every, len(readings.rows)
    transition, noise = np.tile(np.eye(size), (scans, 1, 1)), np.zeros((scans, size, size))
    for stretch, (one, before, after) in enumerate(linear.transitions()):
        at, scales = stretch // count, np.outer(scale, scale)
        transition[at] = one @ transition[at]
        noise[at] = one @ (noise[at] + scales * before) @ one.T + scales * after
    return transition, noise


@dataclass(frozen=True)
class Data:
    """What is known of one run, relative to the truth."""

    error: Array
    """(S, 4) true errors, at the scans, of an INS that senses gravity without the map's part."""
    excess: Array
    """(S,) readings less those of a perfect instrument over the map at the true place."""


def data_of(scenario: Scenario, trajectory: Trajectory, field_map: ScalarMap, run: int) -> Data:
    """Return those of a run of the engine.

    The INS takes off the map's horizontal gravity at the true place. One that does so at its own
    differs by the gravity's gradient, which is a part in a hundred of the Schuler term."""
    truth, scans = scenario.true, scan_index(scenario, trajectory)
    gravity = sensed_gravity(truth.gravity_field, trajectory, [run])
    vector = gravity_vector(truth.gravity_field, trajectory)
    if gravity is not None and vector is not None:
        known = vector.horizontal.value(trajectory.latitude, trajectory.longitude)
        gravity = gravity.copy()
        gravity[..., :2] -= 0.5 * (known[1:] + known[:-1])
    imu = simulate_imu(truth, trajectory, [run], gravity)
    _, track = propagate(
        draw_initial_state(truth.initial_error, trajectory, truth.seed, [run]),
        imu.specific_force,
        imu.angular_rate,
        trajectory.dt,
        trajectory.height,
        history=True,
    )
    at = track[0, scans - 1]
    place = horizontal_difference(
        at[:, 0], at[:, 1], trajectory.latitude[scans], trajectory.longitude[scans]
    )
    speed = at[:, 3:5] - trajectory.velocity[scans, :2]
    source = true_map(truth, scenario.map, trajectory, field_map)
    readings = ReadingSimulator(truth, trajectory, source, [run]).raw[0]
    return Data(
        np.column_stack([place, speed]), readings - true_readings(truth, trajectory, source)
    )


@dataclass(frozen=True)
class Posterior:
    """Of the position after each scan."""

    error: Array
    """(S, 2) m, mean less truth."""
    covariance: Array
    """(S, 2, 2) m²."""


def posterior(
    model: Model, data: Data, count: int, width: float, random: np.random.Generator
) -> Posterior:
    """Return the posterior of one run.

    Parameters
    ----------
    model : Model
    data : Data
    count : int
        Particles.
    width : float
        Of a particle's own position at most, in units of that of all.
    random : Generator
    """
    size, scans = len(model.start), len(data.excess)
    mean, P = np.zeros((count, size)), np.tile(model.start, (count, 1, 1))
    weight = np.full(count, 1.0 / count)
    error, covariance = np.empty((scans, 2)), np.empty((scans, 2, 2))
    for scan in range(scans):
        T = model.transition[scan]
        mean = mean @ T.T
        half = (P.reshape(-1, size) @ T.T).reshape(P.shape).swapaxes(1, 2)
        P = (half.reshape(-1, size) @ T.T).reshape(P.shape) + model.noise[scan]
        narrow(mean, P, _moments(mean, P, weight)[1], width, random)
        moved = data.error[scan, :2] - mean[:, :2]
        value, gradient = model.map_at(scan, moved)
        row = np.tile(model.by_state[scan], (count, 1))
        without = data.error[scan] @ row[0, :4] - mean @ row[0]
        row[:, :2] -= gradient
        column = np.einsum("kij,kj->ki", P, row)
        variance = model.variance + np.einsum("ki,ki->k", row, column)
        innovation = data.excess[scan] - value + without
        mean += column * (innovation / variance)[:, None]
        P -= column[:, :, None] * (column / variance[:, None])[:, None, :]
        log = np.log(weight) - 0.5 * (innovation**2 / variance + np.log(variance))
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        middle, covariance[scan] = _moments(mean, P, weight)
        error[scan] = data.error[scan, :2] - middle
        if weight @ weight > 2.0 / count:
            places = (random.random() + np.arange(count)) / count
            kept = np.searchsorted(np.cumsum(weight), places).clip(max=count - 1)
            mean, P, weight = mean[kept], P[kept], np.full(count, 1.0 / count)
    return Posterior(error, covariance)


def _moments(mean: Array, P: Array, weight: Array) -> tuple[Array, Array]:
    """Return mean (2,) and covariance (2, 2) of the position of all particles."""
    middle = weight @ mean[:, :2]
    apart = mean[:, :2] - middle
    return middle, (weight * apart.T) @ apart + np.einsum("k,kij->ij", weight, P[:, :2, :2])


def narrow(mean: Array, P: Array, whole: Array, width: float, random: np.random.Generator) -> None:
    """Draw part of the position of particles (N, n), (N, n, n) that are wider than `width` in
    units of the covariance (2, 2) of all of them, in place; what all say together stays as it is.
    """
    root = np.linalg.cholesky(whole)
    inverse = np.linalg.inv(root)
    size, axes = np.linalg.eigh(inverse @ P[:, :2, :2] @ inverse.T)
    for k in range(2):
        which = np.flatnonzero(size[:, k] > width**2)
        if which.size == 0:
            continue
        # along a unit axis of the whitened position, of variance size, width² of it stays
        column = np.einsum("kij,kj->ki", P[which, :, :2], axes[which, :, k] @ inverse)
        own = size[which, k]
        drawn = np.sqrt(own - width**2) * random.standard_normal(which.size)
        mean[which] += column * (drawn / own)[:, None]
        share = (1.0 - width**2 / own) / own
        P[which] -= share[:, None, None] * column[:, :, None] * column[:, None, :]


def distances(scenario: Scenario, count: int, run: int) -> closed_loop.Figures:
    """Return the figures of one run of the engine, means over its fixes after the first hour.

    `off` is the squared distance of Isogal's estimate from the reference's mean, and `agreement`
    that of both references, m²; `mean` and `spread` are the parts of the Kullback-Leibler
    divergence (nats), the expected difference in log score, by the means and by the covariances;
    `score` is the difference in log score at the truth."""
    trajectory = build_trajectory(scenario)
    field_map = maps_for_scenario(scenario, trajectory)
    record = simulate(scenario, [run], field_map)
    model = model_of(scenario, trajectory, field_map)
    data = data_of(scenario, trajectory, field_map, run)
    late = record.fix_time - record.time[0] > SETTLED_AFTER
    time = trajectory.time[scan_index(scenario, trajectory)]
    at = np.searchsorted(time, record.fix_time[late] - 1e-6)
    first, second = (
        posterior(model, data, count, width, generator(scenario.seed, run, f"optimum {width}"))
        for width in WIDTHS
    )
    errors = first.error[at], second.error[at]
    own, claimed = record.posterior_error[0, late], record.posterior_covariance[0, late]
    # what the references' randomness adds to their means cancels in products of both
    covariance = 0.5 * (first.covariance + second.covariance)[at]
    inverse = np.linalg.inv(claimed)
    apart = own - errors[0], own - errors[1]
    ratio = np.einsum("kij,kji->k", inverse, covariance)
    larger = np.linalg.slogdet(claimed)[1] - np.linalg.slogdet(covariance)[1]
    found = {
        "mmse": np.einsum("kii->k", covariance),
        "off": np.einsum("ki,ki->k", *apart),
        "agreement": np.einsum("ki,ki->k", errors[0] - errors[1], errors[0] - errors[1]),
        "mean": 0.5 * np.einsum("ki,kij,kj->k", apart[0], inverse, apart[1]),
        "spread": 0.5 * (ratio - 2.0 + larger),
        "larger": 0.5 * larger,
        "score": _score(0.5 * (errors[0] + errors[1]), covariance) - _score(own, claimed),
        "nees": nees_per_axis(0.5 * (errors[0] + errors[1]), covariance),
        "own_nees": nees_per_axis(own, claimed),
        "reference": 0.5 * sum(np.einsum("ki,ki->k", error, error) for error in errors),
        "squared": np.einsum("ki,ki->k", own, own),
    }
    return {name: float(values.mean()) for name, values in found.items()}


def _score(error: Array, covariance: Array) -> Array:
    """Return the log density of a Gaussian at the truth but for a constant, (K,)."""
    return -nees_per_axis(error, covariance) - 0.5 * np.linalg.slogdet(covariance)[1]


HEAD = (
    "row",
    "E‖x − m‖² / MMSE",
    "KL, nats a fix",
    "by the mean",
    "by the covariance",
    "log score",
    "references apart",
    "RMS: Isogal, reference, √MMSE",
    "NEES: reference, Isogal",
)


def line(name: str, runs: Sequence[closed_loop.Figures]) -> list[str]:
    """Return the cells of a row; a standard error is that of the mean over runs."""
    each = {key: np.array([one[key] for one in runs]) for key in runs[0]}
    mean = {key: float(values.mean()) for key, values in each.items()}
    error = {
        key: float(values.std()) / max(1, len(runs) - 1) ** 0.5 for key, values in each.items()
    }
    total = each["mean"] + each["spread"]
    return [
        name,
        f"{mean['off'] / mean['mmse']:.3f} ± {error['off'] / mean['mmse']:.3f}",
        f"{total.mean():.3f} ± {total.std() / max(1, len(runs) - 1) ** 0.5:.3f}",
        f"{mean['mean']:.3f}",
        f"{mean['spread']:.3f} ({100.0 * np.expm1(0.5 * mean['larger']):+.0f} %)",
        f"{mean['score']:.3f} ± {error['score']:.3f}",
        f"{mean['agreement'] / mean['mmse']:.3f}",
        ", ".join(f"{mean[key] ** 0.5:.3g}" for key in ("squared", "reference", "mmse")) + " m",
        f"{mean['nees']:.2f} ± {error['nees']:.2f}, {mean['own_nees']:.2f}",
    ]


def kept(scenario: Scenario, count: int, folder: Path, run: int) -> closed_loop.Figures:
    """Return what `distances` does, from the file where it is."""
    text = json.dumps(scenario.model_dump(mode="json", exclude_defaults=True), sort_keys=True)
    name = hashlib.sha256(f"{text} {WIDTHS} {HEAD} {count} {run}".encode()).hexdigest()[:16]
    path = folder / f"{name}.json"
    if not path.exists():
        write_json(path, distances(scenario, count, run))
    return dict(json.loads(path.read_text(encoding="utf-8")))


def main(given: Sequence[str] | None = None) -> None:
    """Measure, print, and write the page's table."""
    parser = closed_loop.parser(__doc__, "rows", "set", "page", "data", runs=4, workers=2)
    parser.add_argument("--seed", type=int, default=271828)
    parser.add_argument("--only", type=int, nargs="+", metavar="RUN", help="by their numbers")
    parser.add_argument("--particles", type=int, default=2000)
    parser.add_argument("--out", type=Path, default=Path("build/optimum"), help="kept figures")
    options = parser.parse_args(given)
    place = Place(options.data.resolve(), options.out, options.seed)
    runs = options.only or range(options.runs)
    lines = [closed_loop.head_of(HEAD)]
    print(lines[0], flush=True)
    with ProcessPoolExecutor(options.workers) as pool:
        for row in of_the_readme("told"):
            if not closed_loop.containing(row.name, options.rows):
                continue
            changes = [f"seed={options.seed}", *options.set]
            scenario = changed_scenario(row.make(place), changes, "--set")
            measure = partial(kept, scenario, options.particles, options.out)
            found = list(pool.map(measure, runs))
            lines.append(closed_loop.line_of(line(row.name.removesuffix(", told"), found)))
            print(lines[-1], flush=True)
    which = f"runs {options.only}" if options.only else f"{options.runs} runs"
    what = f"Seed {options.seed}, {which}, {options.particles} particles"
    table = f"{', '.join([what, *options.set])}.\n\n" + "\n".join(lines)
    closed_loop.write_between(options.page, closed_loop.marks_of(__file__), table)


if __name__ == "__main__":
    main()
