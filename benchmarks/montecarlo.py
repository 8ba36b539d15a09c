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

import argparse
import datetime
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.scenario_map import map_for_scenario
from isogal.fusion import sigma_points
from isogal.fusion.navigator import FilterModel, FilterState, propagate
from isogal.inertial.rotations import from_rotation_vector, to_rotation_vector
from isogal.inertial.strapdown import step
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.matching.local import LocalPlane
from isogal.matching.paper.kalman import constant_velocity
from isogal.matching.paper.matcher import PaperOptions, PmhtPaper
from isogal.matching.registry import build_matcher
from isogal.montecarlo import engine
from isogal.scenario import Scenario, validate_scenario
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory

HOUR = 3600.0
FILTERPY_STEPS = 400
STONESOUP_BATCHES = 6
ITERATIONS = 15


class Clock:
    """CPU time spent in functions."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def watch(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*args: Any, **kwargs: Any) -> Any:
            start = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[name] = self.seconds.get(name, 0.0) + time.thread_time() - start

        return watched


class WatchedMatcher:
    """A matcher on the clock, which keeps the batches of its first run."""

    def __init__(self, inner: Matcher, clock: Clock) -> None:
        self.inner, self.name, self.context = inner, inner.name, inner.context
        self.timed = clock.watch("matching", inner.match)
        self.batches: list[Batch] = []

    def match(self, batch: Batch, field_map: FieldMap, memory: Any) -> tuple[Fix, Any]:
        if not self.batches or batch.time[-1] > self.batches[-1].time[-1]:
            self.batches.append(batch)
        answer: tuple[Fix, Any] = self.timed(batch, field_map, memory)
        return answer


def isogal_closed_loop(
    scenario: Scenario, field_map: FieldMap, runs: int
) -> tuple[dict[str, float], WatchedMatcher]:
    """CPU seconds of a Monte Carlo, in all and by part."""
    clock = Clock()
    matcher = WatchedMatcher(build_matcher(scenario.matcher), clock)
    kept = engine.propagate, engine.propagate_ins
    engine.propagate = clock.watch("filter", engine.propagate)
    engine.propagate_ins = clock.watch("strapdown", engine.propagate_ins)
    try:
        start = time.thread_time()
        engine.simulate(scenario, range(runs), field_map, matcher)
        clock.seconds["all"] = time.thread_time() - start
    finally:
        engine.propagate, engine.propagate_ins = kept
    return clock.seconds, matcher


@njit(nogil=True, error_model="numpy")
def _sigma_points_through_strapdown(count, nominal, force, rate, dt):  # type: ignore[no-untyped-def]
    points = np.full((sigma_points.N, sigma_points.LANES), 1e-9)
    ends = np.empty((10, sigma_points.LANES))
    for _ in range(count):
        sigma_points.propagate_points(nominal, force, rate, dt, points, ends)
    return ends


def strapdown_share(
    state: FilterState, force: Array, rate: Array, dt: float, count: int = 20000
) -> float:
    """CPU seconds that the strapdown of all sigma points takes in one step of the filter."""
    arguments = (state.nominal_of(0), force, rate, dt)
    _sigma_points_through_strapdown(1, *arguments)
    start = time.thread_time()
    _sigma_points_through_strapdown(count, *arguments)
    return (time.thread_time() - start) / count


class FilterpyNavigator:
    """The same navigator built from filterpy: state latitude, longitude, height, velocity,
    rotation vector, biases."""

    def __init__(self, state: FilterState, model: FilterModel) -> None:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        points = MerweScaledSigmaPoints(15, model.alpha, model.beta, model.kappa)
        self.filter = UnscentedKalmanFilter(
            15, 1, model.dt, hx=lambda x: x[2:3], fx=self._move, points=points
        )
        north, east = metres_per_radian(state.position[0, 0], state.position[0, 2])
        scale = np.array(
            [1 / north, 1 / east, -1.0, *np.ones(12)]
        )  # error states in metres to states in rad
        turn = to_rotation_vector(*state.attitude[0])
        biases = np.concatenate([state.accelerometer_bias[0], state.gyroscope_bias[0]])
        self.filter.x = np.concatenate([state.position[0], state.velocity[0], turn, biases])
        self.filter.P = state.covariance[0] * scale * scale[:, None]
        self.filter.R = np.array([[model.height_sigma**2]])
        noise = np.square(model.noise) * model.dt
        self.filter.Q = np.diag(np.concatenate([np.zeros(3), noise, np.zeros(6)]))
        self.force = self.rate = np.zeros(3)

    def _move(self, x: Array, dt: float) -> Array:
        f, w = self.force - x[9:12], self.rate - x[12:15]
        start = (*x[:3],), (*x[3:6],), from_rotation_vector(*x[6:9])
        position, velocity, attitude = step(*start, (*f,), (*w,), dt)
        return np.concatenate([position, velocity, to_rotation_vector(*attitude), x[9:]])

    def advance(self, force: Array, rate: Array, height: float) -> None:
        self.force, self.rate = force, rate
        self.filter.predict()
        self.filter.update(np.array([height]))


def filterpy_filter(scenario: Scenario) -> dict[str, float]:
    """CPU seconds per simulated second of both filters, and how far they end apart (m)."""
    trajectory = build_trajectory(scenario)
    steps = min(FILTERPY_STEPS, len(trajectory))
    imu = simulate_imu(scenario, trajectory, [0])
    force, rate, height = (
        imu.specific_force[:, :steps],
        imu.angular_rate[:, :steps],
        trajectory.height[1 : steps + 1],
    )
    model = FilterModel.from_scenario(scenario)
    start = FilterState.start(draw_initial_state(scenario, trajectory, [0]), model)
    ours, theirs = start.copy(), FilterpyNavigator(start, model)
    propagate(ours, model, force, rate, height)
    for _ in range(5):  # first calls compile
        theirs._move(theirs.filter.x, model.dt)
    begin = time.thread_time()
    for k in range(steps):
        theirs.advance(force[0, k], rate[0, k], float(height[k]))
    seconds = time.thread_time() - begin
    apart = (ours.position[0, :2] - theirs.filter.x[:2]) * np.array(
        metres_per_radian(ours.position[0, 0])
    )
    if not np.hypot(*apart) < 1.0:
        raise SystemExit(
            f"filterpy's filter ends {np.hypot(*apart):.1f} m from ours: not the same work"
        )
    begin = time.thread_time()
    repeats = 20
    for _ in range(repeats):
        propagate(start.copy(), model, force, rate, height)
    mine = (time.thread_time() - begin) / repeats
    sigma = strapdown_share(start, force[0, 0], rate[0, 0], model.dt)
    simulated = steps * model.dt
    return {
        "filterpy": seconds / simulated,
        "isogal": mine / simulated,
        "strapdown_in_filter": sigma / model.dt,
        "apart_m": float(np.hypot(*apart)),
    }


def stonesoup_batch(batch: Batch, fix: Fix) -> Callable[[], Array]:
    """Return a function that lets Stone Soup match a batch from the candidates of the paper's
    matcher; it gives (T, 2) m."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
    )
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.smoother.kalman import KalmanSmoother
    from stonesoup.tracker.pmht import PMHTTracker
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    assert fix.candidates is not None
    plane = LocalPlane.of(batch)
    places = plane.metres(fix.candidates.latitude, fix.candidates.longitude)
    epoch = datetime.datetime(2000, 1, 1)
    measurement = LinearGaussian(4, (0, 2), np.eye(2) * 250.0**2)
    scans = []
    for t, stamp in enumerate(batch.time):
        when = epoch + datetime.timedelta(seconds=float(stamp))
        mine = places[fix.candidates.scan == t]
        scans.append(
            (
                when,
                {Detection(place[:, None], when, measurement_model=measurement) for place in mine},
            )
        )
    start = plane.metres(batch.latitude[:1], batch.longitude[:1])[0]
    F = constant_velocity(np.diff(batch.time[:2]), 1e-5)[0][0]
    order = np.array([0, 2, 1, 3])  # Stone Soup interleaves position and velocity
    prior = (np.linalg.inv(F) @ batch.prior @ np.linalg.inv(F).T)[np.ix_(order, order)]
    mean = np.array([start[0], batch.velocity[0, 0], start[1], batch.velocity[0, 1]])[:, None]
    transition = CombinedLinearGaussianTransitionModel(
        [ConstantVelocity(1e-5), ConstantVelocity(1e-5)]
    )

    def match() -> Array:
        tracker = PMHTTracker(
            detector=iter(scans),
            predictor=KalmanPredictor(transition),
            updater=KalmanUpdater(measurement),
            smoother=KalmanSmoother(transition),
            meas_range=np.array([[-2500.0, 2500.0], [-2500.0, 2500.0]]),
            clutter_rate=19.0,
            detection_probability=0.99,
            batch_len=len(scans),
            overlap_len=0,
            update_log_pi=False,
            init_priors=[GaussianState(mean, prior, timestamp=scans[0][0])],
            max_num_iterations=ITERATIONS,
        )
        tracker.detector_iter = iter(scans)
        _, tracks = next(tracker)
        (track,) = tracks
        return np.array(
            [[float(state.mean[0]), float(state.mean[2])] for state in track[-len(scans) :]]
        )

    return match


def stonesoup_matching(batches: list[Batch], field_map: FieldMap) -> dict[str, float] | None:
    """CPU seconds per batch of both PMHTs, and how far apart they put its last scan (m, median);
    None without Stone Soup."""
    try:
        import stonesoup.tracker.pmht  # noqa: F401
    except ImportError:
        return None
    paper = PmhtPaper(PaperOptions(iterations=ITERATIONS))
    theirs, mine, apart = [], [], []
    for batch in batches[:STONESOUP_BATCHES]:
        fix, _ = paper.match(batch, field_map, None)
        if fix.candidates is None:
            continue
        repeats = 20
        begin = time.thread_time()
        for _ in range(repeats):
            paper.match(batch, field_map, 1e-9)
        mine.append((time.thread_time() - begin) / repeats)
        match = stonesoup_batch(batch, fix)
        begin = time.thread_time()
        track = match()
        theirs.append(time.thread_time() - begin)
        there = LocalPlane.of(batch).metres(np.array([fix.latitude]), np.array([fix.longitude]))[0]
        apart.append(np.hypot(*(track[-1] - there)))
    if not np.median(apart) < 1500.0:
        raise SystemExit(
            f"Stone Soup's fixes are {np.median(apart):.0f} m from ours: not the same work"
        )
    return {
        "stonesoup": float(np.mean(theirs)),
        "isogal": float(np.mean(mine)),
        "apart_m": float(np.median(apart)),
    }


def measure(runs: int, matcher: str) -> dict[str, Any]:
    """Measure everything; all rates are run-hours of navigation per CPU second."""
    scenario = validate_scenario({"matcher": {"name": matcher}})
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    duration = float(trajectory.time[-1])
    warm = validate_scenario(
        {"matcher": {"name": matcher, "batch_length": 30}, "route": {"duration": 600.0}}
    )
    engine.simulate(warm, [0], field_map)  # compiles
    seconds, watched = isogal_closed_loop(scenario, field_map, runs)
    hours = runs * duration / HOUR
    filters = filterpy_filter(scenario)
    batch = scenario.matcher.batch_length * scenario.gravimeter.interval
    result: dict[str, Any] = {
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
    soup = stonesoup_matching(watched.batches, field_map)
    if soup is not None:
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


def show(result: dict[str, Any]) -> None:
    loop, filters = result["closed_loop"], result["filter"]
    share = loop["share"]
    rest = 1.0 - sum(share.values())
    print(
        f"Run-hours of navigation per CPU second, one core ({result['runs']} runs of the default"
        " scenario)\n"
    )
    print(
        f"  Isogal, closed loop with {result['matcher']:<12}"
        f" {loop['run_hours_per_cpu_second']:10.2f}"
    )
    print(f"    strapdown {share['strapdown']:.0%}, filter {share['filter']:.0%} (of which strapdown of the sigma points "
          f"{loop['share_strapdown_in_filter']:.0%}), matching {share['matching']:.0%}, rest {rest:.0%}")  # fmt: skip
    print(
        f"  filter alone:    Isogal {filters['isogal']:8.1f}   filterpy {filters['filterpy']:8.4f}"
        f"   ratio {filters['ratio']:7.0f}"
    )
    if "matching" in result:
        m = result["matching"]
        print(
            f"  PMHT alone:      Isogal {m['isogal']:8.1f}   Stone Soup {m['stonesoup']:6.4f}  "
            f" ratio {m['ratio']:7.0f}"
        )
    else:
        print(
            "  PMHT alone:      Stone Soup is not installed (pip install -r"
            " benchmarks/requirements.txt)"
        )
    print(
        "\n  Isogal's closed loop over filterpy's filter alone:"
        f" {result['closed_loop_over_filterpy_filter']:.0f} times"
    )
    if "matching" in result:
        print(
            "  Isogal's closed loop over Stone Soup's PMHT alone:"
            f" {result['closed_loop_over_stonesoup_matching']:.0f} times"
        )
    checks = [f"filterpy's filter ends {filters['apart_m']:.2g} m from ours"]
    if "matching" in result:
        checks.append(
            f"Stone Soup's fixes are {result['matching']['apart_m']:.0f} m from ours (median; it"
            " has one covariance for all candidates)"
        )
    print(f"  Checked: {'; '.join(checks)}.")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--matcher", default="pmht-paper")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    if any(
        os.environ.get(name) != value for name, value in threads.items()
    ):  # read when NumPy is loaded: start anew
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | threads)
    result = measure(arguments.runs, arguments.matcher)
    if arguments.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)


if __name__ == "__main__":
    main()
