"""The map of what a scenario measures: the one that it names, or what is computed from it."""

from isogal.fields.derived_maps import derived_maps
from isogal.fields.measured import measured_field
from isogal.fields.source_map import source_map
from isogal.maps.channels import AnyMap
from isogal.maps.load import CORRIDOR_MARGIN
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory


def map_for_scenario(
    scenario: Scenario, trajectory: Trajectory | None = None, margin: float = CORRIDOR_MARGIN
) -> AnyMap:
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
    FieldMap, or ChannelMap of a field with several channels

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than is needed, or does not cover the route.
    """
    if measured_field(scenario).channels is None:
        return source_map(scenario, trajectory, margin)
    return derived_maps(scenario, margin)
