"""``isogal map info``: what is a map, and how good can fixes be along a route?"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from isogal.cli.checks import finite, not_negative, positive
from isogal.cli.map.part import PartChoice, Route
from isogal.cli.map.results import Picture, draw, print_json
from isogal.cli.map_choice import MapChoice
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.arrays import Array
    from isogal.maps.expected_accuracy import Stretches
    from isogal.maps.tiled_map import ScalarMap

ASSUMED = "What is assumed"


@dataclass(frozen=True)
class Assumptions:
    """What the expected accuracy of fixes depends on."""

    PANEL: ClassVar[str] = ASSUMED

    stretch: Annotated[
        float,
        typer.Option(
            metavar="KM", min=0.1, callback=finite, help="Track that a fix is made from."
        ),
    ] = 5.0
    sensor_sigma: Annotated[
        float | None,
        typer.Option(
            callback=positive, help="1-sigma of a reading, map's unit; default: gravimeter.sigma."
        ),
    ] = None
    map_sigma: Annotated[
        float | None,
        typer.Option(
            callback=not_negative, help="1-sigma of the map, its unit; default: as the map says."
        ),
    ] = None
    map_correlation_length: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            callback=positive,
            help="Of the map's error; default: as the map says, or 4000.",
        ),
    ] = None
    bias_sigma: Annotated[
        float,
        typer.Option(min=0.0, callback=finite, help="1-sigma of an unknown offset, map's unit."),
    ] = 0.0

    def stretches(
        self, field_map: "ScalarMap", route: Route, track: "tuple[Array, Array]"
    ) -> "Stretches":
        """Return what readings along a track (latitude, longitude, rad) tell, stretch by stretch;
        raises InputError."""
        from isogal.maps.expected_accuracy import Errors, position_information

        settings = route.settings
        if self.sensor_sigma is None and field_map.unit != "m/s²":
            raise InputError(f"--sensor-sigma: must be given for a map in {field_map.unit}")
        errors = Errors(
            settings.gravimeter.sigma if self.sensor_sigma is None else self.sensor_sigma,
            self.map_sigma,
            self.map_correlation_length
            or field_map.correlation_length
            or settings.matcher.map_correlation_length,
            self.bias_sigma,
        )
        return position_information(field_map, *track, errors, 1e3 * self.stretch)


@with_groups
def info(
    map_: MapChoice,
    where: PartChoice,
    assumed: Assumptions,
    figure: Picture = None,
    json: Json = False,
) -> None:
    """Say what a map is; with a route (--scenario, --set or --route), how good fixes can be along
    it.

    The expected accuracy is the bound on a fix from the readings of one stretch alone, for a
    position already known to within the linear range of the map."""
    from isogal.cli.map.description import describe_map, describe_route

    needed = map_.is_synthetic and where.window is None
    route = where.build() if needed else where.build_if_asked()
    field_map = map_.load_part(where.part(route), route.measured if route else "gravity")
    found = describe_map(field_map)
    track = stretches = None
    if route is not None:
        track = route.readings_on(field_map)
        stretches = assumed.stretches(field_map, route, track)
        found["route"] = describe_route(field_map, track, stretches)
    if figure is not None:
        from isogal.cli.map.figures import map_figure

        draw(figure, map_figure(field_map, track, stretches))
    if json:
        print_json(found)
    else:
        _print(found, field_map.unit, [str(figure)] if figure is not None else [])


def _print(found: dict[str, Any], unit: str, files: list[str]) -> None:
    from isogal.cli.map.description import print_map, print_route

    if "route" in found:
        print_map(found)
        print_route(found["route"], unit, *files)
    else:
        print_map(found, *files)
