"""``isogal plan``: the route that lets the navigator arrive with the least error."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from isogal.cli.checks import place, positive
from isogal.cli.map_choice import MapOption
from isogal.cli.option_groups import with_groups
from isogal.cli.options import RESULTS, Json, ScenarioChoice, number, text, written_file
from isogal.cli.tables import print_result
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.evaluation.planning.planner import Plan, RouteRequest
    from isogal.maps.axes import Window

_MARGIN = 10_000.0  # m of map around the lattice


@dataclass(frozen=True)
class Asked:
    """What is asked of the route."""

    PANEL: ClassVar = "Route"

    start: Annotated[
        str,
        text("'LAT,LON'", "Start, deg.", "--from"),
    ]
    goal: Annotated[str, text("'LAT,LON'", "Goal, deg.", "--to")]
    detour: Annotated[
        float,
        number("How much longer than the straight way, at most.", "SHARE", positive, most=1.0),
    ] = 0.15
    ceiling: Annotated[
        float | None,
        number(
            "Shortest route with an expected error on arrival below this, instead of the"
            " least error.",
            "M",
            positive,
        ),
    ] = None
    no_go: Annotated[
        list[Path] | None, text("FILE.geojson", "Polygons to keep out of; repeatable.")
    ] = None

    def request(self) -> "RouteRequest":
        """Return the same as the library takes it; raises InputError."""
        from isogal.evaluation.planning.areas import read_areas
        from isogal.evaluation.planning.planner import RouteRequest

        areas = tuple(area for path in self.no_go or () for area in read_areas(path))
        start, goal = (
            (math.radians(latitude), math.radians(longitude))
            for latitude, longitude in (place("--from", self.start), place("--to", self.goal))
        )
        return RouteRequest(start, goal, self.detour, self.ceiling, areas)


@dataclass(frozen=True)
class PlanResults:
    """What becomes of the route."""

    PANEL: ClassVar = RESULTS

    out: Annotated[
        list[Path] | None,
        written_file(
            "FILE",
            "Route as .yaml (section route of a scenario) or .geojson; repeatable.",
            *(".yaml", ".yml", ".geojson"),
        ),
    ] = None
    path: Annotated[
        Path | None, written_file("FILE.yaml", "nav_msgs/Path for ros2 topic pub.")
    ] = None
    json: Json = False


@with_groups
def plan(map_: MapOption, asked: Asked, chosen: ScenarioChoice, results: PlanResults) -> None:
    """Find the route from A to B on which the navigator arrives with the least expected error, or
    the shortest with an error below a ceiling.

    The scenario says speed, turn rate, height, sensors and initial errors. The expected error is
    the posterior Cramér-Rao bound along the route as it is driven, at route.height."""
    import numpy as np

    from isogal.cli.progress import Bars
    from isogal.evaluation.navigability.area import fitting
    from isogal.evaluation.planning.planner import plan_route
    from isogal.maps.load import check_coverage

    request = asked.request()
    scenario = chosen.load()
    field_map = map_.given(scenario, "disturbance").flown(scenario.route.height, _around(request))
    check_coverage(field_map, *np.transpose([request.start, request.goal]))
    truth = fitting(scenario.true, field_map)
    with Bars("columns") as bars:
        found = plan_route(
            truth, field_map, request, lambda done, total: bars("columns", done, total)
        )
    _write(found, results)


def _around(request: "RouteRequest") -> "Window":
    """Return the window of all routes."""
    import numpy as np

    from isogal.evaluation.planning.lattice import lattice_between
    from isogal.maps.axes import Window

    if request.start == request.goal:
        raise InputError("--from and --to are the same place")
    lattice = lattice_between(request.start, request.goal, request.detour, [])
    lat, lon = lattice.latitude, lattice.longitude
    return Window(
        float(np.min(lat)), float(np.max(lat)), float(np.min(lon)), float(np.max(lon))
    ).grown(_MARGIN)


def _write(found: "Plan", results: PlanResults) -> None:
    """Write the files and print what was found; raises InputError."""
    import numpy as np

    from isogal.evaluation.planning.files import write_path, write_route

    route, straight = found.route, found.straight
    for name in results.out or ():
        write_route(route, name)
    if results.path is not None:
        write_path(route, results.path)
    files = [str(name) for name in (*(results.out or ()), results.path) if name is not None]
    result = {
        "length_m": route.length,
        "error_on_arrival_m": route.error,
        "largest_error_m": float(route.bound.rms.max()),
        "waypoints": np.degrees(route.waypoints).tolist(),
        "straight": straight
        and {"length_m": straight.length, "error_on_arrival_m": straight.error},
        "files": files,
    }
    lines = [
        f"{route.length / 1e3:.1f} km with {len(route.waypoints)} waypoints, expected error on"
        f" arrival {route.error:.0f} m",
        "the straight way is not free",
    ]
    if straight is not None:
        lines[1] = (
            f"straight: {straight.length / 1e3:.1f} km, {straight.error:.0f} m; detour"
            f" {100.0 * (route.length / straight.length - 1.0):.1f} %"
        )
    print_result(result, results.json, *lines, *files)
