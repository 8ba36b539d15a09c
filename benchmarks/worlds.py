"""Worlds drawn at random, of which the navigator is told nothing: how far it is from the bound,
and whether it says so.

    python benchmarks/worlds.py --data DIR [--worlds 100] [--runs 2] [--seed 20275] [--workers 2]
        [--first 0] [--page docs/evidence/worlds.md]

A world is one choice of each aspect (field, route, speed, interval, noise, inertial sensors, aids,
the map's error, how it starts) and none to three faults. The same seed gives the
same worlds; `--first` goes on. The bound is that of a navigator that knows the world; errors count
after an hour, or a third of the voyage."""

import json
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import closed_loop  # first: it asks NumPy for one thread
import numpy as np
from acceptance_rows import AUSTRALIA

from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.montecarlo.engine import simulate
from isogal.scenario import load_scenario

T = TypeVar("T")
MARKS = closed_loop.marks_of(__file__)
LONGEST_S, LONGEST_M = 10800.0, 200e3
"""A voyage ends after the first of these."""
SURE, FAR = 3.0, 2.0
"""NEES, and ratio to the bound, above which a world is listed."""
BEGIN = -36.6, 147.0
KALGOORLIE = (
    "field=magnetic", "map.source={data}/kalgoorlie_gravity_magnetic.nc",
    "map.variable=magnetic_anomaly", "route.start=[-32.25, 120.95]", "route.end=[-30.1, 122.35]",
    "route.height=300",
)  # fmt: skip
GROUND = ("field=terrain", "map.variable=height", "route.height=2500")


class Field(NamedTuple):
    """What is measured, and the unit of its noise, bias and map errors."""

    name: str
    keys: tuple[str, ...]
    unit: float
    """Of the choices of noise and of the map's error."""


FIELDS = (
    Field("gravity", ("gravimeter.quantity=gravity",), 1e-5),
    Field("disturbance", ("gravimeter.quantity=disturbance",), 1e-5),
    Field("magnetic", KALGOORLIE, 2.0),
    Field("terrain", GROUND, 5.0),
)
FAULTS = {
    "bias": ("truth.gravimeter.bias={bias:g}",),
    "four times the noise": ("truth.gravimeter.sigma={much:g}",),
    "a third of the noise": ("truth.gravimeter.sigma={little:g}",),
    "late by 15 s": ("truth.gravimeter.delay=15",),
    "low-pass of 40 s": ("truth.gravimeter.filter_time=40",),
    "5 % outliers": ("gravimeter.outlier_fraction=0.05",),
    "half missing": ("gravimeter.missing_fraction=0.5",),
    "map error with tails": ("map_error.tails=3",),
}
OTHERS = {
    "noise correlated over 60 s": (
        "truth.gravimeter.correlated_sigma={noise:g}",
        "truth.gravimeter.correlation_time=60",
    ),
    "bias that walks": ("truth.gravimeter.bias_walk={walk:g}",),
    "a gap without readings": ("gravimeter.gaps=[[{half:.0f}, {tenth:.0f}]]",),
    "map datum off": ("map_error.offset={far:g}",),
    "map tilted": ("map_error.tilt={tilt:g}",),
    "start three times as wrong": ("truth.initial_error.position={start:g}",),
    "aid off by 1 %": ("truth.velocity.scale=0.01",),
    "barometer off by 20 m": ("truth.height.bias=20",),
}
"""Drawn last, so that worlds of a seed are otherwise those that they were before."""


def world(seed: int, number: int, data: Path) -> tuple[str, list[str]]:
    """Return the name and the keys of a world."""
    rng = np.random.default_rng([seed, number])

    def one_of(*choices: T) -> T:
        return choices[rng.integers(len(choices))]

    field = one_of(*FIELDS)
    keys = [f"map.source={data / AUSTRALIA}", f"seed={seed + number}", *field.keys]
    names, speed = [field.name], one_of(4.0, 8.0, 22.0, 22.0, 50.0, 80.0)
    duration = min(LONGEST_S, LONGEST_M / speed)
    leg = one_of(None, 10.0, 20.0, 40.0)
    if leg and field.name != "magnetic":
        points = _there_and_back(leg, one_of(0.0, 1.0, 4.0), speed, duration)
        keys.append(f"route.waypoints={json.dumps(points)}")
        names.append(f"legs of {leg:g} km")
    interval, noise = one_of(1, 5, 10, 10, 30), field.unit * one_of(0.1, 1.0, 1.0, 4.0)
    grade = one_of("precision", "navigation", "tactical")
    aid = one_of("dvl", "log") if grade == "tactical" else one_of(None, "dvl", "log")
    wrong = field.unit * one_of(0.0, 1.0, 3.0, 8.0)
    keys += [
        f"route.speed={speed}", f"route.duration={duration:.0f}",
        f"gravimeter.interval={interval}", f"gravimeter.sigma={noise:g}", f"imu.grade={grade}",
        f"map_error.sigma={wrong:g}",
        f"map_error.correlation_length={one_of(1500, 4000, 4000, 10000)}",
    ]  # fmt: skip
    names += [f"{speed:g} m/s", f"every {interval} s", f"noise {noise:g}", grade]
    if wrong:
        names.append(f"map error {wrong:g}")
    if aid:
        keys.append(f"velocity.kind={aid}")
        names.append(aid)
    if one_of(True, False, False):
        keys.append("height.source=barometer")
        names.append("barometer")
    start = one_of(None, None, "satellites", 300, 1000)
    if start == "satellites":
        keys.append(f"gnss.available=[[0, {duration / 4:.0f}]]")
        names.append("satellites at first")
    elif start:
        keys.append(f"initial_error.position={start}")
        names.append(f"start within {start} m")
    sizes = {
        "bias": 3.0 * noise, "much": 4.0 * noise, "little": noise / 3.0, "data": data,
        "noise": noise, "walk": 0.05 * noise, "half": duration / 2.0, "tenth": duration / 10.0,
        "far": 5.0 * field.unit, "tilt": 5e-5 * field.unit,
        "start": 3.0 * (start if isinstance(start, int) else 50.0),
    }  # fmt: skip
    faults = FAULTS | OTHERS
    drawn = rng.choice(list(FAULTS), rng.integers(3), replace=False).tolist()
    if another := one_of(None, None, *OTHERS):
        drawn.append(another)
    for fault in drawn:
        keys += faults[fault]
        names.append(fault)
    return ", ".join(names), [key.format(**sizes) if "{" in key else key for key in keys]


def _there_and_back(
    leg_km: float, apart_km: float, speed: float, duration: float
) -> list[tuple[float, float, float]]:
    """Return waypoints of legs to the north and back, each so far east of the last."""
    points, (latitude, longitude) = [], BEGIN
    by_latitude = 1.0 / 111.2
    by_longitude = by_latitude / math.cos(math.radians(latitude))
    for k in range(int(speed * duration / (1e3 * leg_km)) + 2):
        east = longitude + (k // 2) * apart_km * by_longitude
        north = latitude + (k % 2) * leg_km * by_latitude
        points.append((round(north, 6), round(east, 6), speed))
    return points


def figures(number: int, seed: int, runs: int, data: Path) -> tuple[str, closed_loop.Figures]:
    """Return the name and the figures of a world."""
    name, keys = world(seed, number, data)
    scenario = load_scenario(None, keys)
    record = simulate(scenario, range(runs))
    settled = min(SETTLED_AFTER, float(record.elapsed[-1]) / 3.0)
    bound = closed_loop.bound_of(scenario, record)
    return name, closed_loop.figures_of(scenario, record, bound, settled)


def table_of(found: Sequence[tuple[str, closed_loop.Figures]]) -> str:
    """Return how ratio and NEES are spread, and the worlds that are far off or too sure."""
    each = {key: [one[key] for _, one in found] for key in ("ratio", "nees_settled")}
    shares = (0.1, 0.25, 0.5, 0.75, 0.9)
    spread = closed_loop.markdown(
        ["of the worlds", *(f"{100 * share:.0f} % below" for share in shares)],
        [
            [name, *(f"{np.quantile(each[key], share):.2f}" for share in shares)]
            for name, key in (("error over the bound", "ratio"), ("NEES", "nees_settled"))
        ],
    )
    worst = [
        [name, f"{one['rms']:.0f}", f"{one['bound']:.0f}", f"{one['ratio']:.1f}",
         f"{one['nees_settled']:.1f}"]
        for name, one in sorted(found, key=lambda it: -it[1]["nees_settled"])
        if one["nees_settled"] > SURE or one["ratio"] > FAR
    ]  # fmt: skip
    listed = closed_loop.markdown(["world", "RMS, m", "bound, m", "ratio", "NEES"], worst)
    return f"{len(found)} worlds.\n\n{spread}\n\n{listed}"


def main() -> None:
    """Run it."""
    options = closed_loop.parser(__doc__, "data", "page", "workers", runs=2)
    options.add_argument("--worlds", type=int, default=100, help="how many")
    options.add_argument("--first", type=int, default=0, help="number of the first")
    options.add_argument("--seed", type=int, default=20275)
    asked = options.parse_args()
    job = partial(figures, seed=asked.seed, runs=asked.runs, data=asked.data.resolve())
    found = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for name, one in pool.map(job, range(asked.first, asked.first + asked.worlds)):
            found.append((name, one))
            ratio, nees = one["ratio"], one["nees_settled"]
            print(f"{name}: ratio {ratio:.2f}, NEES {nees:.2f}", flush=True)
    table = table_of(found)
    print(table)
    closed_loop.write_between(asked.page, MARKS, table, seed=asked.seed)


if __name__ == "__main__":
    main()
