"""One run in closed loop whose data are disturbed: IMU samples are missing for a time, fixes come
late, in another order, twice.

    .venv/bin/python benchmarks/disturbed.py [--runs 16] [--duration 9000] [--set KEY=VALUE ...]

The navigator (`isogal.navigator`) is fed sample by sample. Says what each disturbance costs beside
the same runs without: RMS error after half an hour, of an outage over the last third, and NEES per
axis. Of late fixes it also says what the delay alone costs, where matching knows nothing of it:
what has not come yet cannot be used."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import closed_loop
import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import nees_per_axis
from isogal.fields.scenario_map import maps_for_scenario
from isogal.fix import Fix
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import measurements_of
from isogal.inertial.error_state import Estimate
from isogal.matching.registry import build_run_matcher
from isogal.montecarlo.engine import Simulation
from isogal.scenario import Scenario, load_scenario
from isogal.seeds import generator
from isogal.sensors.trajectory import build_trajectory

Delays = Callable[[int], Sequence[float]]
"""Of a fix by its number: how late, s, each copy of it comes."""


def in_time(_fix: int) -> Sequence[float]:
    """Return the delay of a fix that comes once and at once."""
    return (0.0,)


@dataclass(frozen=True)
class Track:
    """What became of a run."""

    time: Array
    """(K,) s, stamps of the states."""
    error: Array
    """(K, 2) m, north and east."""
    covariance: Array
    """(K, 2, 2) m²."""
    fixes: list[tuple[float, Fix]] = field(default_factory=list)

    def rms(self, after: float, before: float = np.inf) -> float:
        """Return the RMS error (m) between two times (s)."""
        part = (self.time > after) & (self.time <= before)
        return float(np.sqrt(np.mean(np.sum(self.error[part] ** 2, axis=1))))

    def nees(self, after: float, before: float = np.inf) -> float:
        """Return the mean NEES per axis between two times (s)."""
        part = (self.time > after) & (self.time <= before)
        return float(np.mean(nees_per_axis(self.error[part], self.covariance[part])))


class Run:
    """A navigator whose IMU samples are missing for a time, and whose fixes come late."""

    def __init__(
        self,
        scenario: Scenario,
        run: int,
        outages: Sequence[tuple[int, int]] = (),
        delays: Delays = in_time,
    ) -> None:
        self.scenario, self.run = scenario, run
        self._truth = build_trajectory(scenario)
        maps = maps_for_scenario(scenario, self._truth)
        self._simulation = Simulation(scenario, [run], self._truth, maps)
        self._navigator = self._simulation.navigator(0, build_run_matcher(scenario))
        self._navigator.inertial.horizon = 1200.0
        self._outages, self._delays = outages, delays
        self._under_way: list[tuple[float, int, Fix, Estimate]] = []
        self._taken: set[int] = set()
        self._fixes: list[tuple[float, Fix]] = []

    def fly(self) -> Track:
        """Navigate to the end."""
        rows, last = [], 0
        of_scan = self.scenario.steps_per_scan
        for k in range(1, len(self._truth) + 1):
            if any(first <= k <= end for first, end in self._outages):
                continue
            sample = self._simulation.samples(0, k - 1, k)
            self._navigator.imu(float(k), *sample, missing=float(k - 1 - last))
            scans = np.arange(last // of_scan + 1, k // of_scan + 1)
            last = k
            self._take_fixes(float(k))
            if len(scans):
                self._read(scans, k)
                self._take_fixes(float(k))
            rows.append(self._row(k))
        time, error, covariance = (np.array(part) for part in zip(*rows, strict=True))
        return Track(time, error, covariance, self._fixes)

    def _row(self, k: int) -> tuple[float, Array, Array]:
        state, truth = self._navigator.state, self._truth
        error = horizontal_difference(*state.position[:2], truth.latitude[k], truth.longitude[k])
        return float(k), np.array(error), state.covariance[:2, :2].copy()

    def _read(self, scans: Integers, k: int) -> None:
        """Take readings; one without a state of its stamp is none."""
        times = scans * float(self.scenario.steps_per_scan)
        readings = self._simulation.sensed(0, 0, scans)
        readings = np.where(times < k - self.scenario.steps_per_scan, np.nan, readings)
        self._navigator.read(0, times, readings)
        matched = self._navigator.match()
        if matched is None:
            return
        estimate = Estimate(*(part.copy() for part in self._navigator.state.estimate))
        self._fixes.append((float(k), matched.fix))
        self._send(len(self._fixes), float(k), matched.fix, estimate)

    def _send(self, number: int, time: float, fix: Fix, estimate: Estimate) -> None:
        """Let a fix come when it comes."""
        self._under_way += [(time + x, number, fix, estimate) for x in self._delays(number)]
        self._under_way.sort(key=lambda item: item[0])

    def _take_fixes(self, now: float) -> None:
        while self._under_way and self._under_way[0][0] <= now:
            _, number, fix, estimate = self._under_way.pop(0)
            if number not in self._taken:
                self._taken.add(number)
                self._navigator.apply(fix, estimate)


class Listener(Run):
    """A run in time, and a second filter that hears of the same fixes late: what became of that
    one."""

    def __init__(self, scenario: Scenario, run: int, delays: Delays) -> None:
        super().__init__(scenario, run, delays=delays)
        first = self._navigator.inertial
        self._second = InertialNavigator(first.model, first.state, first.time)

    def _row(self, k: int) -> tuple[float, Array, Array]:
        self._second.imu(float(k), *self._simulation.samples(0, k - 1, k))
        for item in [item for item in self._under_way if item[0] <= k]:
            self._under_way.remove(item)
            parts = [(item[2].time, part) for part in measurements_of(item[2], item[3])]
            self._second.measure_all(parts)
        state, truth = self._second.state, self._truth
        error = horizontal_difference(*state.position[:2], truth.latitude[k], truth.longitude[k])
        return float(k), np.array(error), state.covariance[:2, :2].copy()

    def _send(self, number: int, time: float, fix: Fix, estimate: Estimate) -> None:
        super()._send(number, time, fix, estimate)
        self._navigator.apply(fix)

    def _take_fixes(self, now: float) -> None:
        """They have been taken at once."""


def late(scenario: Scenario, run: int, longest: float) -> Delays:
    """Return random delays up to a longest (s), which change the fixes' order; one fix in five
    comes twice."""
    rng = generator(scenario.seed, run, "late fixes")

    def delays(_fix: int) -> Sequence[float]:
        copies = 2 if rng.uniform() < 0.2 else 1
        return [float(np.floor(x)) for x in rng.uniform(0.0, longest, copies)]

    return delays


def outage(scenario: Scenario, run: int, seconds: int) -> list[tuple[int, int]]:
    """Return when samples are missing: for some seconds from a time on that is drawn."""
    rng = generator(scenario.seed, run, "outage")
    first = int(rng.uniform(0.25, 0.45) * (scenario.route.duration or 0.0))
    return [(first, first + seconds - 1)]


CASES: dict[str, Callable[[Scenario, int], Run]] = {
    "undisturbed": Run,
    "fixes up to 120 s late": lambda it, run: Run(it, run, delays=late(it, run, 120.0)),
    "as late, matched in time": lambda it, run: Listener(it, run, late(it, run, 120.0)),
    "no IMU samples for 60 s": lambda it, run: Run(it, run, outage(it, run, 60)),
    "no IMU samples for 180 s": lambda it, run: Run(it, run, outage(it, run, 180)),
}


def main() -> None:
    parser = closed_loop.parser(__doc__, "set", runs=16, duration=9000.0)
    parser.add_argument("--only", default="", help="cases whose names have this in them")
    options = parser.parse_args()
    scenario = load_scenario(None, [*options.set, f"route.duration={options.duration}"])
    cases = {name: fly for name, fly in CASES.items() if options.only in name or "un" in name}
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in cases}
    last = options.duration * 2.0 / 3.0
    for run in range(options.runs):
        for name, made in cases.items():
            track = made(scenario, run).fly()
            # fixes that are late cost something all the time, an outage shows when it is over
            since = 1800.0 if "late" in name or name == "undisturbed" else last
            found[name].append((track.rms(since), track.nees(since), track.rms(last)))
        print(run, {name: np.round(rows[-1], 2).tolist() for name, rows in found.items()})
    for name, rows in found.items():
        errors, nees, _ = np.array(rows).T
        plain = np.array(found["undisturbed"]).T[2 if "IMU" in name else 0]
        ratio = float(np.sqrt(np.mean(errors**2) / np.mean(plain**2)))
        line = {"rms_m": float(np.sqrt(np.mean(errors**2))), "ratio": ratio}
        print(name, json.dumps(line | {"nees_per_axis": float(nees.mean())}))


if __name__ == "__main__":
    main()
