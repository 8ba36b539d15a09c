"""The map of what a scenario measures: the one that it names, or what is computed from it."""

import math
from typing import Final

from isogal.errors import InputError
from isogal.fields.derived_maps import derived_maps
from isogal.fields.measured import measured_field
from isogal.fields.source_map import MapSource
from isogal.maps.axes import Window
from isogal.maps.channels import RouteMap
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import check_coverage
from isogal.maps.several import FieldMaps, RunMap
from isogal.scenario import Assumed, Map, Settings, Truth
from isogal.sensors.trajectory import Trajectory, build_trajectory

_SMALL: Final = 700_000
"""Cells of a map that is continued in this process."""
EVERYWHERE: Final = Window(-0.5 * math.pi, 0.5 * math.pi, -math.pi, math.pi)


def map_for_scenario(
    settings: Settings, trajectory: Trajectory | None = None, margin: float | None = None
) -> RouteMap:
    """Return the map of what a scenario measures at the flown height, cut to its route.

    Parameters
    ----------
    settings : Settings
        Its ``map``, field and route.
    trajectory : Trajectory, optional
        The route's points, if they are there already.
    margin : float
        m of map kept around the route, as far as the map reaches; default: `map.margin`.

    Returns
    -------
    FieldMap, or TiledMap if it is large; ChannelMap of a field with several channels

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than is needed, or does not cover the route;
        or the scenario has several fields.
    """
    margin = settings.map.margin if margin is None else margin
    several = measured_field(settings).channels is not None
    if margin is None:
        if several:
            raise InputError("map.margin: a number is needed where a reading has several")
        return MapSource.of(settings).flown(settings.route.height, EVERYWHERE)
    if several:
        return derived_maps(settings, margin)
    route = trajectory or build_trajectory(settings)
    corridor = corridor_of(route.latitude, route.longitude, margin)
    source = MapSource.of(settings)
    field_map, height = source.along(corridor), settings.route.height
    if source.continues(field_map, height):
        whole = isinstance(field_map, FieldMap)
        if whole and (settings.map.terrain is not None or math.prod(field_map.shape) > _SMALL):
            field_map = derived_maps(settings, margin).channels[0]
        else:
            field_map = source.flown_along(height, field_map, corridor)
    partly = settings.route.track is not None
    check_coverage(field_map, route.latitude, route.longitude, partly=partly)
    return field_map


def maps_for_scenario(assumed: Assumed, trajectory: Trajectory | None = None) -> RunMap:
    """Return the map of what a scenario measures, or those of its several fields; see
    `map_for_scenario`."""
    if assumed.fields is None:
        return map_for_scenario(assumed, trajectory)
    route = trajectory or build_trajectory(assumed)
    return FieldMaps(tuple(map_for_scenario(one, route) for one in assumed.each_field))


def true_map(truth: Truth, matched: Map, trajectory: Trajectory, field_map: RouteMap) -> RouteMap:
    """Return the map that readings are simulated from: `field_map`, which is matched, unless the
    truth names another than `matched` does.

    Raises
    ------
    InputError
        See `map_for_scenario`.
    """
    return field_map if truth.map == matched else map_for_scenario(truth, trajectory)
