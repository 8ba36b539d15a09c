"""The map that a scenario names: synthetic, or read from where it says."""

from functools import partial

from isogal import plugins
from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.maps.axes import Window
from isogal.maps.corridor import Corridor
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.maps.tiled_map import ScalarMap, map_along
from isogal.scenario import Settings

_SYNTHETIC = "synthetic"


def source_map_along(scenario: Settings, corridor: Corridor) -> ScalarMap:
    """Return the map that a scenario names along its route, tiled if it is large.

    Raises
    ------
    InputError
        The map cannot be read, or is of another quantity than the sensor.
    """
    if scenario.map.source == _SYNTHETIC:
        from isogal.maps.synthetic.synthetic_map import synthetic_map_along  # slow to import

        field_map = synthetic_map_along(_synthetic_quantity(scenario), corridor)
    else:
        field_map = map_along(_reader(scenario), corridor)
    _check_quantity(scenario, field_map)
    return field_map


def variable_along(scenario: Settings, variable: str, corridor: Corridor) -> ScalarMap:
    """Return another variable of the map that a scenario names, along its route.

    Raises
    ------
    InputError
        There is none, or it cannot be read.
    """
    if scenario.map.source == _SYNTHETIC:
        raise InputError(f"map.variable: the synthetic map has no {variable}")
    other = scenario.map.model_copy(update={"variable": variable})
    return map_along(_reader(scenario.model_copy(update={"map": other})), corridor)


def source_map(scenario: Settings, window: Window) -> FieldMap:
    """Return the map that a scenario names in a window, whole and in memory.

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than the sensor, or is too large.
    """
    if scenario.map.source == _SYNTHETIC:
        from isogal.maps.synthetic.synthetic_map import synthetic_map

        field_map = synthetic_map(_synthetic_quantity(scenario), window)
    else:
        field_map = _reader(scenario)(window=window)
    _check_quantity(scenario, field_map)
    return field_map


def disturbance_beside(scenario: Settings, window: Window) -> FieldMap | None:
    """Return the map of the disturbance that the source of a scenario's map of gravity holds as
    well; None if it does not."""
    if scenario.map.source == _SYNTHETIC:
        from isogal.maps.synthetic.synthetic_map import synthetic_map

        return synthetic_map("disturbance", window)
    reader = _reader(scenario)
    try:
        found = load_map(reader.args[0], None, "disturbance", window, **reader.keywords)
    except InputError:
        return None
    return found if found.quantity == "disturbance" else None


def _reader(scenario: Settings) -> partial[FieldMap]:
    """Return the function that reads the file or folder that a scenario names."""
    source, path = scenario.map.source, scenario.map.path
    named = source in plugins.names(plugins.MAP_FORMATS)
    if named and path is None:
        raise InputError(
            f"map.path: must name the file or folder, since map.source is the format '{source}'"
        )
    if not named and path is not None:
        raise InputError(
            "map.source: must be 'synthetic' or a format"
            f" ({', '.join(plugins.names(plugins.MAP_FORMATS))}) where map.path is given"
        )
    variable = scenario.map.variable
    return partial(
        load_map,
        path if named and path is not None else source,
        variable,
        None if variable else measured_field(scenario).source,
        format_name=source if named else None,
    )


def _check_quantity(scenario: Settings, field_map: ScalarMap) -> None:
    """Raise InputError unless a map is of the quantity that the scenario's field needs."""
    field = measured_field(scenario)
    if field_map.quantity != field.source:
        needs = "" if field.channels is None else f", which needs one of {field.source}"
        key = "field" if scenario.field else "gravimeter.quantity"
        raise InputError(
            f"map: {field_map.provenance} is a {field_map.quantity} map, but {key} is"
            f" {scenario.measured_field}{needs}; change map.variable or {key}"
        )


def _synthetic_quantity(scenario: Settings) -> str:
    names = {
        "ga": "gravity",
        "dg": "disturbance",
        "gravity": "gravity",
        "disturbance": "disturbance",
        "height": "height",
        None: measured_field(scenario).source,
    }
    if scenario.map.variable not in names:
        raise InputError(
            f"map.variable: the synthetic map has height, ga and dg, not '{scenario.map.variable}'"
        )
    return names[scenario.map.variable]
