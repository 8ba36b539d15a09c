"""Maps of several fields that are matched in one run, each on a grid and in a unit of its own."""

from dataclasses import dataclass

from isogal.maps.channels import RouteMap


@dataclass(frozen=True, eq=False)
class FieldMaps:
    """A map for each field of a scenario, in the order of its list `fields`."""

    maps: tuple[RouteMap, ...]


RunMap = RouteMap | FieldMaps
"""What a run needs: the map of its field, or those of its fields."""


def each_map(run_map: RunMap) -> tuple[RouteMap, ...]:
    """Return the map of each field, or the only one."""
    return run_map.maps if isinstance(run_map, FieldMaps) else (run_map,)


def first_map(run_map: RunMap) -> RouteMap:
    """Return the map of the first field, which figures show."""
    return each_map(run_map)[0]
