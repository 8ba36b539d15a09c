"""A scenario's map at the height where its vehicle goes (docs/maps.md, section "At the height of
the flight").

Where the values hold is said by `map.terrain` (on the ground; the vehicle goes on a level), or by
`map.level` or the map itself (on a level). If nothing says it they hold on the map's surface, and
the vehicle goes `route.height` above that everywhere. There a map of gravity changes as the
disturbance does: what else is in it is the height of the surface itself. So the source has to hold
a map of the disturbance as well; otherwise it is taken as it is."""

from dataclasses import replace

import numpy as np

from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.fields.source_map import disturbance_beside, source_map
from isogal.maps.axes import Window
from isogal.maps.continuation.blocks import CONTINUED, continued, rim_of
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import ScalarMap
from isogal.scenario import Scenario

_SYNTHETIC = "synthetic"
_RIM_ON_GROUND = 20_000.0
"""m of the ground around a place that are taken into account at least."""


def told_level(scenario: Scenario, field_map: ScalarMap) -> float | None:
    """Return the height (m, counted as `route.height`) of the level that a map's values hold on;
    None where neither scenario nor map says it."""
    return field_map.height if scenario.map.level is None else scenario.map.level


def is_elsewhere(scenario: Scenario, field_map: ScalarMap) -> bool:
    """Tell whether a map has to be continued to the flown height."""
    if scenario.map.continuation == "none" or field_map.quantity not in CONTINUED:
        return False
    if scenario.map.terrain is not None:
        return True
    level = told_level(scenario, field_map)
    if scenario.route.height == (level or 0.0):
        return False
    return level is not None or field_map.quantity != "gravity" or _knows(scenario, field_map)


def _knows(scenario: Scenario, field_map: ScalarMap) -> bool:
    """Tell whether the source of a map of gravity holds the disturbance, too."""
    south, north, west, east = field_map.extent[:4]
    middle = 0.5 * (south + north), 0.5 * (west + east)
    window = Window(middle[0], middle[0], middle[1], middle[1]).grown(_RIM_ON_GROUND)
    return disturbance_beside(scenario, window) is not None


def read_at_flown_height(scenario: Scenario, *, window: Window) -> FieldMap:
    """Return the scenario's map in a window at the flown height, whole and in memory: the function
    that `isogal.maps.tiled_map.TiledMap` takes, once the scenario is given.

    Raises
    ------
    InputError
        The map cannot be read, or not be continued.
    """
    source = source_map(scenario, window)
    if not is_elsewhere(scenario, source):
        return source
    wide = window.grown(_reach(scenario, source))._replace(most_cells=2 * window.most_cells)
    try:
        return _at_flown_height(scenario, source_map(scenario, wide), wide).window(*window[:4])
    except InputError as error:
        raise InputError(
            f"{error} (the map at route.height; with map.continuation: none it is taken as it is)"
        ) from None


def disturbance_for_gradients(scenario: Scenario, source: FieldMap) -> tuple[FieldMap, float]:
    """Return a map of the disturbance on a level, and how far (m) the vehicle goes above that.

    Raises
    ------
    InputError
        The vehicle goes below it.
    """
    if scenario.map.terrain is not None:
        return _from_ground(scenario, source), 0.0
    rise = scenario.route.height - (told_level(scenario, source) or 0.0)
    if rise < 0.0:
        raise InputError(
            f"route.height: must not be below the map's level where field is gradient, is"
            f" {-rise:g} m below it: a map cannot be continued down towards the masses"
        )
    return source, rise


def _reach(scenario: Scenario, field_map: FieldMap) -> float:
    """Return how far (m) beyond a place the map is needed to continue it there."""
    rise = scenario.route.height - (told_level(scenario, field_map) or 0.0)
    rim = rim_of(rise, scenario.map.downward_cutoff)
    return rim if scenario.map.terrain is None else max(rim, _RIM_ON_GROUND)


def _at_flown_height(scenario: Scenario, source: FieldMap, window: Window) -> FieldMap:
    if scenario.map.terrain is not None:
        return _from_ground(scenario, source)
    level, height = told_level(scenario, source), scenario.route.height
    cutoff = scenario.map.downward_cutoff if height < (level or 0.0) else None
    if level is not None or source.quantity != "gravity":
        above = continued(source, height, level or 0.0, cutoff=cutoff)
        return above if level is not None else replace(above, height=None)
    return _gravity_above_surface(scenario, source, window, cutoff)


def _gravity_above_surface(
    scenario: Scenario, source: FieldMap, window: Window, cutoff: float | None
) -> FieldMap:
    """Return a map of gravity changed as the disturbance beside it changes."""
    beside = disturbance_beside(scenario, window)
    if beside is None or beside.values.shape != source.values.shape:
        raise InputError(f"{source.provenance}: the disturbance beside it is on another grid")
    step = beside.quantisation
    beside = replace(
        beside,
        sigma=source.sigma,
        correlation_length=source.correlation_length,
        quantisation=0.0,
        provenance=source.provenance,
    )
    above = continued(beside, scenario.route.height, 0.0, cutoff=cutoff)
    return replace(
        above,
        values=source.values + (above.values - beside.values),
        quantity="gravity",
        height=None,
        # the change is that of rounded values, too
        quantisation=float(np.hypot(source.quantisation, step)),
        file_unit=source.file_unit,
        file_factor=source.file_factor,
    )


def _from_ground(scenario: Scenario, source: FieldMap) -> FieldMap:
    """Continue a map whose values hold on the ground."""
    from isogal.maps.continuation.terrain import from_terrain

    ground = _ground(scenario, source)
    gravity = source.quantity == "gravity"
    if gravity:
        latitude, longitude = source.latitude[:, None], source.longitude
        normal = normal_gravity(latitude, ground.value(latitude, longitude))
        source = replace(source, values=source.values - normal, quantity="disturbance")
    result = from_terrain(source, ground, scenario.route.height)
    if not gravity:
        return result
    # as a reading is reduced: with the mean change with height taken off
    normal = normal_gravity(result.latitude)[:, None]
    values = result.values.astype(np.float64) + normal
    return replace(result, values=values, quantity="gravity")


def _ground(scenario: Scenario, source: FieldMap) -> FieldMap:
    """Return the height of the ground, in the window of a map."""
    from isogal.maps.load import load_map

    terrain = scenario.map.terrain
    assert terrain is not None
    if terrain == _SYNTHETIC:
        from isogal.maps.synthetic.synthetic_map import synthetic_map

        return synthetic_map("height", source.extent)
    return load_map(terrain, quantity="height", window=source.extent)
