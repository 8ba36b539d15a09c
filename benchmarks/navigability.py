"""What `isogal map navigability` promises against what runs reach, at random places and headings.

    python benchmarks/navigability.py --data DIR --out DIR [--places 30] [--runs 24]
        [--far 2000] [--bin-places 10] [--bin-runs 40]
        [--page docs/evidence/navigability.md]

DIR of `--data` holds `se_australia_gravity.nc`. First the expected error: places and headings
drawn at random, the default scenario and an exact map. Then the probability of a second place,
with a start known to `--far` m (1-sigma) only: places are drawn until there are so many in each
range of what is promised. There, each run is one batch, matched by itself. The best place is wrong
where the true one is outside its 99.9 % ellipse."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import TypeVar

import closed_loop
import numpy as np

from isogal.arrays import Array
from isogal.evaluation.navigability.area import Area
from isogal.evaluation.navigability.leg import leg_route
from isogal.files import write_atomic
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.matching.interfaces import Batch, Fix, Matcher, declined
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.search import Diverged
from isogal.matching.registry import load_matcher
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, validate_scenario
from isogal.seeds import generator

MARKS = closed_loop.marks_of(__file__)
RANGES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
"""Of the promised probability of a second place."""
_OUTSIDE = 13.8
"""Chi-square of two degrees of freedom that one in a thousand exceeds."""
_TOUCHING, _VALLEY = 4.0, 0.1
"""Squared distance of two hypotheses of one place, and density in units of the largest one below
which there is a valley between two places."""
Memory = TypeVar("Memory")
_MARGIN = 0.12
"""Share of the map along its edges in which no place is drawn."""
_SECOND = 0.05
"""Probability beside the best place from which on a posterior holds a second one."""


@dataclass(frozen=True)
class Case:
    """A place and a heading, with what is promised there."""

    row: int
    column: int
    heading: float
    promised: float


@dataclass
class Listening:
    """A matcher that says nothing to the navigator, and remembers what it found."""

    matcher: Matcher
    found: list[tuple[Array, Array, float]] = field(default_factory=list)
    """Of each batch: mean (2,), covariance (2, 2) and probability of the heaviest place."""

    def __post_init__(self) -> None:
        self.name, self.context = self.matcher.name, self.matcher.context
        self.takes_channels = self.matcher.takes_channels

    def match(self, batch: Batch, field_map: FieldMap, memory: Memory) -> tuple[Fix, Memory]:
        """Match one batch; see `isogal.matching.interfaces.Matcher`."""
        _, after = self.matcher.match(batch, field_map, None)
        bank = after.fields[0].bank
        # a bank is about what the fix leaves
        them = _searched(after.diverged, field_map) if bank is None else bank.moved(-after.taken)
        wide = np.zeros(2), batch.prior[:2, :2], 0.0
        self.found.append(wide if them is None else heaviest(them))
        return declined(batch, "only listening"), after


def _searched(diverged: Diverged, field_map: FieldMap) -> Hypotheses | None:
    """Return the hypotheses of a search that takes all readings at once; None where it has too
    many places to begin with."""
    search = diverged.search
    while search is not None and search.done < len(diverged.past):
        search = search.later(diverged.past, field_map.grid)
    return None if search is None else search.hypotheses


def heaviest(bank: Hypotheses) -> tuple[Array, Array, float]:
    """Return mean (2,) and covariance (2, 2) of the heaviest place, and its probability.

    A place is what is left and right of the densest hypothesis without a valley in between: those
    of at least `_VALLEY` of its density that touch it, or another one of it."""
    weight = np.exp(bank.log_weight - np.logaddexp.reduce(bank.log_weight))
    within = bank.covariance[:, :2, :2]
    apart = bank.mean[:, None, :2] - bank.mean[:, :2]
    inverse = np.linalg.inv(within[:, None] + within)
    touching = np.einsum("kli,klij,klj->kl", apart, inverse, apart) < _TOUCHING
    density = weight / np.sqrt(np.linalg.det(within))
    dense = density > _VALLEY * density.max()
    place = np.arange(len(bank)) == np.argmax(density)
    while (grown := touching[place].any(axis=0) & dense).sum() > place.sum():
        place = grown
    same = bank.part(place)
    mean, covariance = same.moments()
    return mean[:2], covariance[:2, :2], float(weight[touching[place].any(axis=0)].sum())


def draw(area: Area, count: int, seed: int) -> list[tuple[int, int, float]]:
    """Return rows, columns and headings (rad) of random places."""
    random = generator(seed, 0, "navigability")
    rows, columns = area.field_map.shape
    margin = int(_MARGIN * min(rows, columns))
    return [
        (
            int(random.integers(margin, rows - margin)),
            int(random.integers(margin, columns - margin)),
            float(random.uniform(0.0, 2.0 * math.pi)),
        )
        for _ in range(count)
    ]


def at(area: Area, case: tuple[int, int, float]) -> Scenario:
    """Return the scenario of a leg."""
    row, column, heading = case
    ground = area.field_map
    latitude, longitude = float(ground.latitude[row]), float(ground.longitude[column])
    route = leg_route(area.truth, latitude, longitude, heading)
    return area.truth.informed.model_copy(update={"route": route})


def errors(ground: FieldMap, places: int, runs: int) -> dict[str, list[float]]:
    """Return promised and reached RMS errors on arrival (m) of the default scenario, whose matcher
    is told that the map is exact."""
    settings = {"gravity": {"field": "normal"}, "matcher": {"map_sigma": 0.0}}
    area = Area(validate_scenario(settings).true, ground)
    promised, reached = [], []
    for case in draw(area, places, 0):
        nodes = np.array([case[0]]), np.array([case[1]])
        promised.append(float(area.errors(area.leg(case[2]), *nodes)[0, 0]))
        record = simulate(at(area, case), range(runs), ground)
        reached.append(float(np.sqrt((record.error[:, -1] ** 2).sum(axis=1).mean())))
    return {"promised": promised, "reached": reached}


def places_of(area: Area, each: int) -> list[Case]:
    """Return cases, so many in each range of what is promised, or what 4,000 draws give."""
    kept: list[list[Case]] = [[] for _ in RANGES[1:]]
    for row, column, heading in draw(area, 4000, 1):
        found = area.ambiguity(area.leg(heading), np.array([row]), np.array([column]))
        promised = float(found[0, 0])
        which = int(np.searchsorted(RANGES, promised, side="right")) - 1
        if math.isfinite(promised) and len(kept[min(which, len(kept) - 1)]) < each:
            kept[min(which, len(kept) - 1)].append(Case(row, column, heading, promised))
        if all(len(one) == each for one in kept):
            break
    return [case for one in kept for case in one]


@dataclass(frozen=True)
class Found:
    """What runs at a place have found."""

    promised: float
    """Probability of a second place."""
    wrong: int
    """Runs whose best place was wrong."""
    second: int
    """Runs that held a second place."""
    left: float
    """Mean probability beside the best place."""
    runs: int


HEAD = (
    *("promised", "mean", "places", "best place wrong (95 %)", "a second place held"),
    "probability beside the best place",
)


def second_places(ground: FieldMap, far: float, each: int, runs: int) -> list[Found]:
    """Return of each case what is promised, and what runs find there."""
    settings = {
        "gravity": {"field": "normal"},
        "initial_error": {"position": far},
        "matcher": {"map_sigma": 0.0, "batch_length": 30, "stride": 30},
    }
    area = Area(validate_scenario(settings).true, ground)
    results = []
    for case in places_of(area, each):
        leg = at(area, (case.row, case.column, case.heading))
        ear = Listening(load_matcher(leg.matcher))
        record = simulate(leg, range(runs), ground, ear)
        truth = record.error[:, -1]
        wrong = [
            _outside(*place[:2], error) for place, error in zip(ear.found, truth, strict=True)
        ]
        left = np.array([1.0 - sure for _, _, sure in ear.found])
        seconds = int((left > _SECOND).sum())
        results.append(Found(case.promised, int(sum(wrong)), seconds, float(left.mean()), runs))
        print(results[-1], flush=True)
    return results


def _outside(mean: Array, covariance: Array, error: Array) -> bool:
    """Whether the navigator's error (2,) is outside the ellipse of the best place."""
    return bool((error - mean) @ np.linalg.solve(covariance, error - mean) > _OUTSIDE)


def rank_correlation(a: Sequence[float], b: Sequence[float]) -> float:
    """Return Spearman's."""
    from scipy.stats import spearmanr

    return float(spearmanr(a, b).statistic)


def table(
    error: dict[str, list[float]], second: Sequence[Found], options: argparse.Namespace
) -> str:
    """Return the results as Markdown."""
    from scipy.stats import binomtest

    ratio = np.array(error["reached"]) / np.array(error["promised"])
    shares = [one.wrong / one.runs for one in second]
    order = rank_correlation([one.promised for one in second], shares)
    text = (
        f"Expected error: {options.places} places, {options.runs} runs at each: rank correlation"
        f" of promised and reached {rank_correlation(error['promised'], error['reached']):.2f},"
        f" median of reached / promised {np.median(ratio):.2f} ({ratio.min():.2f} to"
        f" {ratio.max():.2f}).\n\nSecond place: a start known to {options.far:.0f} m,"
        f" {len(second)} places, {options.bin_runs} runs at each; rank correlation of what is"
        f" promised and the share of runs whose best place is wrong {order:.2f}."
    )
    rows = []
    for low, high in pairwise(RANGES):
        part = [one for one in second if low <= one.promised < high]
        if not part:
            continue
        runs = sum(one.runs for one in part)
        bad = sum(one.wrong for one in part)
        interval = binomtest(bad, runs).proportion_ci(0.95, "wilson")
        rows.append(
            [
                f"{low:.2f} to {high:.2f}",
                f"{np.mean([one.promised for one in part]):.3f}",
                f"{len(part)}",
                f"{bad / runs:.3f} ({interval.low:.3f} to {interval.high:.3f})",
                f"{sum(one.second for one in part) / runs:.3f}",
                f"{np.mean([one.left for one in part]):.3f}",
            ]
        )
    return f"{text}\n\n{closed_loop.markdown(HEAD, rows)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute both, print the tables, and write them into a page."""
    parser = closed_loop.parser(__doc__, "data", "out", "page", runs=24)
    parser.add_argument("--places", type=int, default=30)
    parser.add_argument("--bin-places", type=int, default=10)
    parser.add_argument("--bin-runs", type=int, default=40)
    parser.add_argument("--far", type=float, default=2000.0)
    options = parser.parse_args(arguments)
    ground = load_map(options.data / "se_australia_gravity.nc", "dg")
    second = second_places(ground, options.far, options.bin_places, options.bin_runs)
    error = errors(ground, options.places, options.runs)
    text = table(error, second, options)
    print(text)
    results = {"error": error, "second": [asdict(one) for one in second]}
    write_atomic(options.out / "navigability.json", json.dumps(results, indent=1))
    closed_loop.write_between(options.page, MARKS, text)


if __name__ == "__main__":
    main()
