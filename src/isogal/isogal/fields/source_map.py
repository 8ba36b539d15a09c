"""The map that a scenario names: synthetic, or read from where it says."""

from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.maps.field_map import FieldMap
from isogal.maps.load import CORRIDOR_MARGIN, FORMATS, check_coverage, load_map, route_window
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory


def source_map(
    scenario: Scenario, trajectory: Trajectory | None = None, margin: float = CORRIDOR_MARGIN
) -> FieldMap:
    """Return the map that a scenario names; for several channels, all of it that theirs are
    computed from.

    Parameters
    ----------
    scenario : Scenario
        Its ``map``, field and route.
    trajectory : Trajectory, optional
        The route's points, if they are there already.
    margin : float
        m of map kept around the route, as far as the map reaches.

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than the sensor, or does not cover the
        route.
    """
    route = trajectory or build_trajectory(scenario)
    field = measured_field(scenario)
    quantity, channels = field.source, field.channels
    window = route_window(route.latitude, route.longitude, margin)
    if channels is not None:
        window = window.grown(channels.reach)  # and all of it, also what is off the track
    source, path = scenario.map.source, scenario.map.path
    if source == "synthetic":
        from isogal.maps.synthetic.tiles import synthetic_map  # which takes some time to load

        field_map = synthetic_map(_synthetic_quantity(scenario), window)
    else:
        named = source in {f.name for f in FORMATS}
        if named and path is None:
            raise InputError(
                "map.path: must name the file or folder, since map.source is the format"
                f" '{source}'"
            )
        if not named and path is not None:
            raise InputError(
                "map.source: must be 'synthetic' or a format"
                f" ({', '.join(f.name for f in FORMATS)}) where map.path is given"
            )
        variable = scenario.map.variable
        field_map = load_map(
            path if named and path is not None else source,
            variable,
            None if variable else quantity,
            window,
            format_name=source if named else None,
        )
    if field_map.quantity != quantity:
        needs = "" if channels is None else f", which needs one of {quantity}"
        key = "field" if scenario.field else "gravimeter.quantity"
        raise InputError(
            f"map: {field_map.provenance} is a {field_map.quantity} map, but {key} is"
            f" {scenario.measured_field}{needs}; change map.variable or {key}"
        )
    check_coverage(field_map, route.latitude, route.longitude)
    return field_map


def _synthetic_quantity(scenario: Scenario) -> str:
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
