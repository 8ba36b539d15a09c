"""One run in closed loop whose data are disturbed: IMU samples are missing for a time, fixes come
late, in another order, twice.

    .venv/bin/python benchmarks/disturbed.py [--runs 16] [--duration 9000] [--set KEY=VALUE ...]

The navigator is the one of the node (`isogal.fusion.buffered`), fed sample by sample; batches and
matcher are those of the engine. Says what each disturbance costs beside the same runs without:
RMS error after half an hour, of an outage over the last third, and NEES per axis. Of late fixes it
also says what the delay alone costs, where matching knows nothing of it: what has not come yet
cannot be used."""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import nees_per_axis
from isogal.fields.gravity_vector import felt_gravity
from isogal.fields.known_gravity import known_gravity
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario, true_map
from isogal.fields.simulator import ReadingSimulator, compensated
from isogal.fix import apply_fix
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.model import FilterModel
from isogal.fusion.outage import HELD
from isogal.fusion.state import FilterState
from isogal.inertial.dead_reckoning import dead_reckoned
from isogal.inertial.error_state import Estimate, batch_difference
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import Fix
from isogal.matching.registry import load_matcher
from isogal.scenario import Scenario, load_scenario
from isogal.seeds import generator
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.reduction import State
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


class World:
    """What a run of a scenario measures, whoever navigates with it."""

    def __init__(self, scenario: Scenario, run: int) -> None:
        self.scenario, self.run = scenario, run
        self.trajectory = build_trajectory(scenario)
        self.map = map_for_scenario(scenario, self.trajectory)
        world = scenario.world
        known = known_gravity(scenario, self.trajectory)
        felt = felt_gravity(world, self.trajectory, [run])
        self.imu = simulate_imu(world, self.trajectory, [run], felt)
        source = true_map(scenario, self.trajectory, self.map)
        readings = ReadingSimulator(world, self.trajectory, source, [run])
        self.readings = compensated(scenario, self.trajectory, readings)[0]
        self.model = FilterModel.from_scenario(scenario, known)
        self.start = FilterState.start(
            draw_initial_state(world, self.trajectory, [run]), self.model
        )


class Run:
    """A navigator, its batches and what the matcher remembers."""

    def __init__(
        self,
        world: World,
        outages: Sequence[tuple[int, int]] = (),
        delays: Delays = in_time,
    ) -> None:
        self._world, self._outages, self._delays = world, outages, delays
        scenario = world.scenario
        self._matcher = load_matcher(scenario.matcher, False)
        field = measured_field(scenario)
        self._reduction = field.reduction(scenario)
        self._builder = BatchBuilder(
            scenario.matcher,
            self._reduction,
            self._matcher.context,
            scenario.gravimeter,
            scenario.height,
        )
        self._memory: Any = None
        self._navigator = BufferedNavigator(world.model, world.start.copy())
        self._under_way: list[tuple[float, int, Fix, Estimate]] = []
        self._taken: set[int] = set()
        self._fixes: list[tuple[float, Fix]] = []

    def fly(self) -> Track:
        """Navigate to the end."""
        world, rows = self._world, []
        of_scan = world.scenario.steps_per_scan
        last = 0
        for k in range(1, len(world.trajectory) + 1):
            if not any(first <= k <= end for first, end in self._outages):
                self._advance(k, k - 1 - last)
                last = k
                self._take_fixes(float(k))
                rows.append(self._row(k))
            if k % of_scan == 0:
                self._scan(k, last)
                self._take_fixes(float(k))
                if last == k:
                    rows[-1] = self._row(k)
        time, error, covariance = (np.array(part) for part in zip(*rows, strict=True))
        return Track(time, error, covariance, self._fixes)

    def _advance(self, k: int, missing: int) -> None:
        imu, before = self._world.imu, self._navigator
        then = before.time, before.state.batch_prior[0]
        before.propagate(
            float(k),
            imu.specific_force[0, k - 1],
            imu.angular_rate[0, k - 1],
            float(self._world.trajectory.height[k]),
            float(missing),
        )
        if missing > HELD:
            self._builder.bridge(*then, before.time, before.state.batch_prior[0])

    def _row(self, k: int) -> tuple[float, Array, Array]:
        state, truth = self._navigator.state, self._world.trajectory
        error = horizontal_difference(
            *state.position[0, :2], truth.latitude[k], truth.longitude[k]
        )
        return float(k), np.array(error), state.covariance[0, :2, :2].copy()

    def _scan(self, k: int, last: int) -> None:
        """Take a scan; without a state of its stamp it has no reading."""
        state, scenario = self._navigator.state, self._world.scenario
        position, velocity = state.position[0], state.velocity[0]
        reading = self._world.readings[k // scenario.steps_per_scan - 1]
        estimate = State(*position, velocity[0], velocity[1])
        reduced = float(self._reduction.reduce(np.array(reading), estimate))
        if last < k:
            position, reduced = dead_reckoned(position, velocity, float(k - last)), np.nan
        self._builder.add_scan(
            float(k),
            position[0],
            position[1],
            velocity[:2],
            reduced,
            scenario.gravimeter.sigma,
            height=position[2],
        )
        if self._builder.ready and last == k:
            self._match(k)

    def _match(self, k: int) -> None:
        state = self._navigator.state
        batch = self._builder.build(state.batch_prior[0])
        near = self._world.map.near(batch.latitude, batch.longitude)
        fix, self._memory = self._matcher.match(batch, near, self._memory)
        estimate = Estimate(*(part.copy() for part in state.estimate_of(0)))
        self._fixes.append((float(k), fix))
        number = len(self._fixes)
        for late in self._delays(number):
            self._under_way.append((k + late, number, fix, estimate))
        self._under_way.sort(key=lambda item: item[0])

    def _take_fixes(self, now: float) -> None:
        while self._under_way and self._under_way[0][0] <= now <= self._navigator.time + 0.5:
            _, number, fix, estimate = self._under_way.pop(0)
            if number in self._taken:
                continue
            self._taken.add(number)
            before = self._navigator.state.copy()
            apply_fix(fix, self._navigator.at(fix.time, estimate))
            after = self._navigator.state
            change = batch_difference(after.estimate_of(0), before.estimate_of(0))
            if change.any():
                self._builder.correct(now, change)


class Listener(Run):
    """A run in time, and a second navigator that hears of the same fixes late: what became of
    that one."""

    def __init__(self, world: World, delays: Delays) -> None:
        super().__init__(world)
        self._own = self._navigator
        self._second = BufferedNavigator(world.model, world.start.copy())
        self._heard_when = delays
        self._unheard: list[tuple[float, Fix, Estimate]] = []

    def _advance(self, k: int, missing: int) -> None:
        super()._advance(k, missing)
        self._navigator = self._second
        super()._advance(k, missing)
        self._navigator = self._own

    def _row(self, k: int) -> tuple[float, Array, Array]:
        self._navigator = self._second
        row = super()._row(k)
        self._navigator = self._own
        return row

    def _match(self, k: int) -> None:
        super()._match(k)
        _, number, fix, estimate = self._under_way[-1]
        self._unheard.append((k + min(self._heard_when(number)), fix, estimate))

    def _take_fixes(self, now: float) -> None:
        super()._take_fixes(now)
        for item in [item for item in self._unheard if item[0] <= now]:
            self._unheard.remove(item)
            apply_fix(item[1], self._second.at(item[1].time, item[2]))


def late(scenario: Scenario, run: int, longest: float) -> Delays:
    """Return random delays up to a longest (s), which change the fixes' order; one fix in five
    comes twice."""
    rng = generator(scenario.seed, run, "late fixes")

    def delays(_fix: int) -> Sequence[float]:
        copies = 2 if rng.uniform() < 0.2 else 1
        return [float(np.floor(x)) for x in rng.uniform(0.0, longest, copies)]

    return delays


def late_of(world: World) -> Delays:
    """Return the delays of a world's run."""
    return late(world.scenario, world.run, 120.0)


def outage(scenario: Scenario, run: int, seconds: int) -> list[tuple[int, int]]:
    """Return when samples are missing: for some seconds from a time on that is drawn."""
    rng = generator(scenario.seed, run, "outage")
    first = int(rng.uniform(0.25, 0.45) * (scenario.route.duration or 0.0))
    return [(first, first + seconds - 1)]


CASES: dict[str, Callable[[World], Run]] = {
    "undisturbed": Run,
    "fixes up to 120 s late": lambda world: Run(world, delays=late_of(world)),
    "as late, matched in time": lambda world: Listener(world, late_of(world)),
    "no IMU samples for 60 s": lambda world: Run(world, outage(world.scenario, world.run, 60)),
    "no IMU samples for 180 s": lambda world: Run(world, outage(world.scenario, world.run, 180)),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--only", default="", help="cases whose names have this in them")
    parser.add_argument("--duration", type=float, default=9000.0, help="s to simulate")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    scenario = load_scenario(None, [*options.set, f"route.duration={options.duration}"])
    cases = {name: fly for name, fly in CASES.items() if options.only in name or "un" in name}
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in cases}
    last = options.duration * 2.0 / 3.0
    for run in range(options.runs):
        world = World(scenario, run)
        for name, made in cases.items():
            track = made(world).fly()
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
