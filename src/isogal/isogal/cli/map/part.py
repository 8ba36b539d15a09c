"""Which part of a map a command works on: a window, or what lies about a route."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

from isogal.cli.checks import place
from isogal.cli.options import ScenarioChoice, number, text
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.arrays import Array
    from isogal.maps.axes import Window
    from isogal.maps.corridor import Corridor
    from isogal.maps.tiled_map import ScalarMap
    from isogal.scenario import Scenario
    from isogal.sensors.trajectory import Trajectory

PART = "Part of the Earth"
"""Heading of these options."""
_SPEED = 22.0
"""m/s along a route that is given by its points alone."""


class Route(NamedTuple):
    """A scenario and its route."""

    settings: "Scenario"
    trajectory: "Trajectory"

    @property
    def measured(self) -> str:
        """Quantity of the map that the scenario's sensor needs."""
        from isogal.fields.measured import measured_field

        return measured_field(self.settings).source

    def around(self, margin: float) -> "Corridor":
        """Return the part of the Earth within a margin (km) of the route."""
        from isogal.maps.corridor import corridor_of

        return corridor_of(self.trajectory.latitude, self.trajectory.longitude, 1e3 * margin)

    def readings_on(self, field_map: "ScalarMap") -> "tuple[Array, Array]":
        """Return latitude and longitude (rad) of the readings along the route.

        Raises
        ------
        InputError
            The map does not cover them.
        """
        from isogal.maps.load import check_coverage

        scans = slice(None, None, self.settings.steps_per_scan)
        places = self.trajectory.latitude[scans], self.trajectory.longitude[scans]
        check_coverage(field_map, *places)
        return places


@dataclass(frozen=True)
class RouteChoice(ScenarioChoice):
    """Which route, and how much of the map about it."""

    PANEL: ClassVar[str] = PART

    route: Annotated[
        str | None,
        text("'LAT,LON LAT,LON ...'", "Route by its points, deg, instead of the scenario's."),
    ] = None
    margin: Annotated[float, number("Map kept around a route.", "KM", least=0.0)] = 25.0

    def load(self, *changes: str) -> "Scenario":
        """Return the scenario with the route of ``--route``; raises InputError."""
        if self.route is not None:
            changes = f"route.waypoints={_waypoints(self.route)}", "route.duration=null", *changes
        return super().load(*changes)

    def build(self) -> Route:
        """Return the route, by default that of the default scenario; raises InputError."""
        from isogal.sensors.trajectory import build_trajectory

        settings = self.load()
        return Route(settings, build_trajectory(settings))

    def build_if_asked(self) -> Route | None:
        """Return the route if an option names a scenario or a route; raises InputError."""
        asked = self.scenario is not None or bool(self.set_) or self.route is not None
        return self.build() if asked else None


@dataclass(frozen=True)
class PartChoice(RouteChoice):
    """A window, or a route and how much of the map about it."""

    window: Annotated[
        tuple[float, float, float, float] | None,
        text("SOUTH NORTH WEST EAST", "Part of the map, deg."),
    ] = None

    def part(self, route: Route | None) -> "Window | Corridor | None":
        """Return the window, else what lies about a route; None = the whole map. Raises
        InputError."""
        if self.window is not None:
            return _window(*self.window)
        return None if route is None else route.around(self.margin)

    def part_needed(self) -> "Window | Corridor":
        """Return the window, else what lies about the route, by default that of the default
        scenario; raises InputError."""
        if self.window is None:
            return self.build().around(self.margin)
        self.build_if_asked()  # a wrong scenario is refused, although the window counts
        return _window(*self.window)


def _waypoints(route: str) -> str:
    """Return ``--route`` as the value of the scenario's key `route.waypoints`."""
    points = [[*place("--route", item), _SPEED] for item in route.split()]
    if len(points) < 2:
        raise InputError(f"--route '{route}': needs at least two points")
    return str(points)


def _window(south: float, north: float, west: float, east: float) -> "Window":
    from isogal.maps.axes import Window

    if not (
        -90.0 <= south < north <= 90.0
        and -360.0 <= west <= 360.0
        and -360.0 <= east <= 360.0
        and west != east
    ):
        raise InputError(
            f"--window {south:g} {north:g} {west:g} {east:g}: must be SOUTH NORTH WEST EAST in"
            " deg, south below north"
        )
    south, north, west, east = map(math.radians, (south, north, west, east))
    return Window(south, north, west, east)
