"""The search for a route in belief space: over places and what the navigator knows there.

The error covariance is carried along the edges of a lattice (information filter over a graph:
Prentice & Roy 2009, Int. J. Robotics Research 28(11-12); Bry & Roy 2011, Proc. IEEE ICRA). One
covariance does not always beat another in every direction, and a longer way may pay later. So each
place keeps several ways to it: the one of least error for each of some classes of length, counted
with the least way that is left to the goal. What is kept is compared by the variances of position
and velocity, these over some minutes.

The route that is found, and the straight one, are then assessed by the bound along the route as it
is driven, with its turns (`isogal.evaluation.bound`)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.evaluation.bound import BoundResult, posterior_cramer_rao
from isogal.evaluation.planning.areas import Rings, inside
from isogal.evaluation.planning.belief import Edges
from isogal.evaluation.planning.lattice import Lattice, lattice_between
from isogal.maps.field_map import FieldMap
from isogal.scenario import Route, Truth
from isogal.sensors.trajectory import Trajectory, build_trajectory

CLASSES = 10
"""Of length, for which each place keeps a way."""
_HORIZON = 300.0  # s, over which a velocity error counts
_SHARPEST = math.radians(75.0)
_DRIVEN = 0.98
"""Share of the detour that the edges may take; turns take the rest."""

Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class RouteRequest:
    """What is asked of a route."""

    start: Place
    """Latitude, longitude, rad."""
    goal: Place
    detour: float = 0.15
    """Share of the straight way that the route may be longer, above 0."""
    ceiling: float | None = None
    """m: the shortest route whose RMS error on arrival is below; None = the least error."""
    areas: tuple[Rings, ...] = ()

    def check(self) -> None:
        """Raise InputError unless this can be asked."""
        for name, place in (("start", self.start), ("goal", self.goal)):
            if inside(list(self.areas), np.array(place[0]), np.array(place[1])).any():
                raise InputError(f"{name} lies in an area that the route must keep out of")


@dataclass(frozen=True, slots=True, eq=False)
class Assessed:
    """A route as it is driven, and the bound along it."""

    waypoints: Array
    """(W, 2) latitude, longitude, rad."""
    driven: Route
    trajectory: Trajectory
    bound: BoundResult

    @property
    def length(self) -> float:
        """m."""
        return float(self.trajectory.time[-1] * self.driven.speed)

    @property
    def error(self) -> float:
        """m, RMS horizontal error on arrival."""
        return float(self.bound.rms[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The route found, and the straight one."""

    route: Assessed
    straight: Assessed | None
    """None where an area is in the way."""


@dataclass(slots=True, eq=False)
class _Way:
    """A way to a place."""

    length: float
    covariance: Array
    cost: float
    direction: int | None
    rows: tuple[int, ...]
    """From the start on."""


def plan_route(
    truth: Truth,
    field_map: FieldMap,
    request: RouteRequest,
    progress: Callable[[int, int], None] | None = None,
) -> Plan:
    """Find a route.

    Parameters
    ----------
    truth : Truth
        Speed, turn rate, height, sensors and initial errors; its route's points do not count.
    field_map : FieldMap
        Of what is measured.
    request : RouteRequest
    progress : function, optional
        Called with the number of columns of the lattice that are done, and of all.

    Raises
    ------
    InputError
        No route keeps out of all areas within the detour, or none has an error below the ceiling.
    """
    request.check()
    radius = truth.route.speed / truth.route.turn_rate
    # as much of an edge as the turns at both of its ends take, so that none is overshot
    shortest = 2.0 * radius * math.tan(0.5 * _SHARPEST)
    areas = list(request.areas)
    lattice = lattice_between(request.start, request.goal, request.detour, areas, shortest)
    least = 4.0 * radius
    if lattice.straight < least:
        raise InputError(
            f"start and goal are {lattice.straight:.0f} m apart; with this speed and turn rate a"
            f" route needs {least:.0f} m"
        )
    ends = _search(truth, field_map, request, lattice, progress)
    if not ends:
        raise InputError(
            f"the goal cannot be reached: no way keeps out of the areas within"
            f" {100.0 * request.detour:.3g} % of detour"
        )
    straight = None
    if lattice.free[:, lattice.middle, len(lattice.rise) // 2].all():
        straight = assess(truth, field_map, np.array([request.start, request.goal]))
    found = [assess(truth, field_map, _corners(lattice, way.rows)) for way in ends]
    if straight is not None:
        found.append(straight)
    if request.ceiling is None:
        return Plan(min(found, key=lambda one: one.error), straight)
    good = [one for one in found if one.error <= request.ceiling]
    if not good:
        best = min(one.error for one in found)
        raise InputError(
            f"no route within {100.0 * request.detour:.3g} % of detour has an expected error below"
            f" {request.ceiling:g} m; the best has {best:.0f} m"
        )
    return Plan(min(good, key=lambda one: one.length), straight)


def assess(truth: Truth, field_map: FieldMap, waypoints: Array) -> Assessed:
    """Return the bound along a route (W, 2) through all waypoints to the last, as it is driven."""
    points = tuple((*np.degrees(place).tolist(), truth.route.speed) for place in waypoints)
    driven = truth.route.model_copy(update={"waypoints": points, "duration": None})
    truth = truth.model_copy(update={"route": driven})
    trajectory = build_trajectory(truth)
    bound = posterior_cramer_rao(truth, trajectory, field_map)
    return Assessed(waypoints, driven, trajectory, bound)


def _search(
    truth: Truth,
    field_map: FieldMap,
    request: RouteRequest,
    lattice: Lattice,
    progress: Callable[[int, int], None] | None,
) -> list[_Way]:
    """Return the ways that reach the goal, one for each class of length at most."""
    edges = Edges(truth, lattice, field_map)
    most = (1.0 + _DRIVEN * request.detour) * lattice.straight
    columns, speed = len(lattice.free), truth.route.speed
    ways = [_Way(0.0, edges.start(*request.start), 0.0, None, (lattice.middle,))]
    for column in range(columns):
        reached: dict[int, dict[int, _Way]] = {}
        for direction, length in enumerate(lattice.length.tolist()):
            going = [way for way in ways if _may_go(way, column, direction, lattice, most)]
            if not going:
                continue
            rows = [way.rows[-1] for way in going]
            covariances = edges.along(
                np.array([way.covariance for way in going]),
                lattice.latitude[column, rows],
                lattice.longitude[column, rows],
                np.array([way.length for way in going]) / speed,
                direction,
            )
            for way, P in zip(going, covariances, strict=True):
                cost = float(P[0, 0] + P[1, 1] + _HORIZON**2 * (P[2, 2] + P[3, 3]))
                there = way.rows[-1] + int(lattice.rise[direction])
                after = _Way(way.length + length, P, cost, direction, (*way.rows, there))
                excess = after.length + lattice.left(column + 1, there) - lattice.straight
                kind = min(int(CLASSES * excess / (most - lattice.straight)), CLASSES - 1)
                kept = reached.setdefault(there, {})
                if kind not in kept or cost < kept[kind].cost:
                    kept[kind] = after
        ways = [way for kept in reached.values() for way in _useful(kept)]
        if progress is not None:
            progress(column + 1, columns)
    return [way for way in ways if way.rows[-1] == lattice.middle]


def _may_go(way: _Way, column: int, direction: int, lattice: Lattice, most: float) -> bool:
    """Return whether a way may go on from a column in a direction: not into an area, nor too far
    (m) or round a sharp corner."""
    here = way.rows[-1]
    there = here + int(lattice.rise[direction])
    if not (0 <= there < lattice.free.shape[1] and lattice.free[column, here, direction]):
        return False
    if way.direction is not None:
        turn = lattice.heading[direction] - lattice.heading[way.direction]
        if abs(math.remainder(turn, 2.0 * math.pi)) > _SHARPEST:
            return False
    whole = way.length + lattice.length[direction] + lattice.left(column + 1, there)
    return bool(whole <= most * (1.0 + 1e-9))


def _useful(kept: dict[int, _Way]) -> list[_Way]:
    """Return the ways of which no shorter one has less error."""
    useful: list[_Way] = []
    for kind in sorted(kept):
        if not useful or kept[kind].cost < useful[-1].cost:
            useful.append(kept[kind])
    return useful


def _corners(lattice: Lattice, rows: Sequence[int]) -> Array:
    """Return the start, the places where a way turns, and the goal (W, 2), rad."""
    turns = [0]
    turns += [k for k in range(1, len(rows) - 1) if rows[k + 1] - rows[k] != rows[k] - rows[k - 1]]
    turns.append(len(rows) - 1)
    return np.array([(lattice.latitude[k, rows[k]], lattice.longitude[k, rows[k]]) for k in turns])
