"""The map of what a scenario measures: the one that it names, or what is computed from it."""

from isogal.fields.derived_maps import derived_maps
from isogal.fields.measured import measured_field
from isogal.fields.source_map import source_map_along
from isogal.maps.channels import RouteMap
from isogal.maps.corridor import CORRIDOR_MARGIN, corridor_of
from isogal.maps.load import check_coverage
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory


def map_for_scenario(
    scenario: Scenario, trajectory: Trajectory | None = None, margin: float = CORRIDOR_MARGIN
) -> RouteMap:
    """Return the map of what a scenario measures, cut to its route.

    Parameters
    ----------
    scenario : Scenario
        Its ``map``, field and route.
    trajectory : Trajectory, optional
        The route's points, if they are there already.
    margin : float
        m of map kept around the route, as far as the map reaches.

    Returns
    -------
    FieldMap, or TiledMap if it is large; ChannelMap of a field with several channels

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than is needed, or does not cover the route.
    """
    if measured_field(scenario).channels is None:
        route = trajectory or build_trajectory(scenario)
        field_map = source_map_along(
            scenario, corridor_of(route.latitude, route.longitude, margin)
        )
        check_coverage(field_map, route.latitude, route.longitude)
        return field_map
    return derived_maps(scenario, margin)


def true_map(scenario: Scenario, trajectory: Trajectory, field_map: RouteMap) -> RouteMap:
    """Return the map that readings are simulated from: the given one, which is matched, unless
    `truth.map` names another.

    Raises
    ------
    InputError
        See `map_for_scenario`.
    """
    world = scenario.world
    return field_map if world.map == scenario.map else map_for_scenario(world, trajectory)
