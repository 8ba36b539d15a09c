"""``isogal bag``: a table of what an INS has said becomes a recording."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isogal.cli.option_groups import with_groups
from isogal.cli.options import ScenarioChoice, flag, text, written_folder
from isogal.cli.run import require_ros
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.arrays import Array
    from isogal.inertial.ins_file import InsFile
    from isogal.scenario import Scenario


@with_groups
def bag(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.csv",
            help=(
                "Columns time, latitude, longitude and, as far as there are, height,"
                " velocity_north, velocity_east, velocity_down, roll, pitch, heading, value,"
                " sigma."
            ),
        ),
    ],
    out: Annotated[Path, written_folder("The recording.")],
    chosen: ScenarioChoice,
    unit: Annotated[
        str | None,
        text("UNIT", "Of value and sigma, such as mGal; default: that of the header, SI, nT."),
    ] = None,
    replace: Annotated[
        bool, flag("--replace", "Delete an earlier recording in the folder.")
    ] = False,
) -> None:
    """Make a recording (MCAP, as ros2 bag lays it out) of what an INS has said, for `isogal
    replay`: position, velocity and attitude, and readings of the scenario's field.

    The column value holds readings as they are matched, reduced with the INS's own position and
    velocity: what the instrument sensed goes into the recording, to be reduced anew.

    Times are seconds or ISO 8601; velocity is in m/s, angles in deg. A header that names another
    unit counts: time[ms], height[ft], velocity_north[kn], heading[rad], value[mGal]. Where the
    scenario has no route of its own, that is the straight line from the first to the last
    place."""
    from isogal.inertial.ins_file import read_ins_file

    require_ros("a recording")
    from isogal_ros.bags.from_ins import write_ins_bag

    first = chosen.load()
    said = read_ins_file(file, first.route.height)
    scenario = chosen.load(*_changes(first, said))
    count = write_ins_bag(out, scenario, said, _readings(scenario, said, unit), replace)
    typer.echo(f"{out}: {count} messages, {said.time[-1] - said.time[0]:.0f} s")


def _changes(scenario: "Scenario", said: "InsFile") -> list[str]:
    """Return what a file says of the keys of a scenario."""
    import numpy as np

    attitude = str(said.has_attitude).lower()
    found = ["ins.source=solution", f"ins.attitude={attitude}"]
    if scenario.route != type(scenario)().route:
        return found
    places = np.degrees(said.solution[[0, -1], :2])
    speed = float(np.median(np.hypot(*said.solution[:, 3:5].T)))
    if np.array_equal(*places) or speed == 0.0:
        why = "the INS ends where it began" if speed else "the INS stands still most of the time"
        raise InputError(f"route: {why}; give --set route.start and route.end, route.speed")
    start, end = (f"[{latitude!r}, {longitude!r}]" for latitude, longitude in places.tolist())
    height = float(np.median(said.solution[:, 2]))
    found += [f"route.start={start}", f"route.end={end}", f"route.speed={speed!r}"]
    return [*found, f"route.height={height!r}", "route.duration=null"]


def _readings(scenario: "Scenario", said: "InsFile", unit: str | None) -> "Array | None":
    """Return (N, 2) what the instrument sensed, by what was made of it with the INS's own state,
    and its 1-sigma, unit inside; None where there are no readings."""
    import numpy as np

    from isogal.fields.measured import measured_field
    from isogal.inertial.rotations import matrix
    from isogal.maps.quantities import check_plausible, unit_factor, value_range
    from isogal.sensors.reduction import State

    if said.value is None:
        return None
    field, factor = measured_field(scenario), 1.0
    where, unit = ("value", said.unit) if unit is None else ("--unit", unit)
    if unit is not None:
        inside, factor = unit_factor(unit, where)
        if inside != field.unit:
            raise InputError(
                f"{where}: '{unit}' does not fit {field.name}, which is in {field.unit}"
            )
    check_plausible(value_range(said.value[None]), field.quantity, factor, "value")
    sigma = np.zeros(len(said.time)) if said.sigma is None else np.nan_to_num(said.sigma) * factor
    latitude, longitude, height, v_north, v_east = said.solution[:, :5].T
    at = State(latitude, longitude, height, v_north, v_east, matrix(said.solution[:, 6:]))
    sensed = np.asarray(field.reduction(scenario).raw(said.value * factor, at))
    if sensed.ndim > 1:
        raise InputError(f"value: {field.name} has readings of several numbers, not one column")
    return np.column_stack([sensed, sigma])
