"""The commands of ``isogal mag``: a magnetometer on a magnetic vehicle."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, flag, number, text, written_file, written_folder
from isogal.cli.tables import print_result
from isogal.errors import InputError

if TYPE_CHECKING:
    from pydantic import JsonValue

    from isogal.arrays import Array
    from isogal.magnetics.flight import MagneticFlight


app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Clean a magnetometer of the vehicle's own field.",
)


@dataclass(frozen=True)
class FlightChoice:
    """Which flight, and what its file does not say."""

    flight: Annotated[
        Path,
        typer.Argument(
            metavar="FLIGHT",
            help="CSV or XYZ file with the columns time (s or ISO 8601), scalar, vector_x,"
            " vector_y, vector_z (nT), and if you like latitude, longitude (deg), height (m),"
            " current_NAME (A) and reference (nT, the true field).",
        ),
    ]
    base: Annotated[
        Path | None,
        text(
            "FILE",
            "Base station with the columns time and scalar: its daily variation is taken off.",
        ),
    ] = None
    height: Annotated[
        float | None, number("Above the ellipsoid, where the file has no column height.", "M")
    ] = None
    epoch: Annotated[
        float,
        number(
            "Of the main field, where the times are not UTC.", "YEAR", least=1900.0, most=2030.0
        ),
    ] = 2025.0

    def read(self) -> "MagneticFlight":
        """Return the flight, less the daily variation; raises InputError."""
        from isogal.magnetics.flight import read_magnetic_flight

        return read_magnetic_flight(self.flight, self.base)


@dataclass(frozen=True)
class Fitting:
    """How coefficients are learnt."""

    PANEL: ClassVar = "Calibration"

    lag: Annotated[
        float | None,
        number(
            "By which the vector magnetometer is late; default: found out.",
            "S",
            least=-10,
            most=10,
        ),
    ] = None

    force: Annotated[
        bool,
        flag(
            "--force",
            "Take a flight whose manoeuvres are too small for what it tells; the rest of the"
            " coefficients stays near zero, with a sigma that says how far off they may be.",
        ),
    ] = False


@app.command()
@with_groups
def calibrate(
    chosen: FlightChoice,
    fitting: Fitting,
    out: Annotated[Path, written_file("FILE.yaml", "Coefficients.")],
    report: Annotated[Path | None, written_folder("Page with a figure.")] = None,
    json: Json = False,
) -> None:
    """Learn what a vehicle adds to the total magnetic field from a calibration flight: rolls,
    pitches and yaws on four headings, high above the ground.

    The coefficients are those of Tolles and Lawson: 3 of permanent magnetisation, 6 of induced, 9
    of eddy currents, and 3 for each current that is measured."""
    from isogal.evaluation.calibration_report import in_words, summary, write_calibration_report
    from isogal.magnetics.calibration import Settings
    from isogal.magnetics.calibration import calibrate as learn

    settings, flight = Settings(**vars(fitting)), chosen.read()
    known = flight.reference
    if known is None and flight.places is not None:
        # where no height is known, that at zero: only its changes count
        unknown = flight.height is None and chosen.height is None
        known = flight.main_field(chosen.epoch, 0.0 if unknown else chosen.height)
    found = learn(flight.readings, known, settings, flight.reference is not None)
    found.compensation.write(out)
    files = [str(out)]
    if report is not None:
        files.append(str(write_calibration_report(flight, found, report)))
    numbers = summary(flight, found)
    print_result(numbers | {"files": files}, json, *in_words(numbers, found), *files)


@dataclass(frozen=True)
class Coefficients:
    """What is known of the vehicle."""

    coefficients: Annotated[Path | None, text("FILE.yaml", "Of isogal mag calibrate.")] = None
    online: Annotated[
        bool,
        flag(
            "--online",
            "Learn on the way, from --coefficients or from nothing: each reading is"
            " compensated by those before it.",
        ),
    ] = False
    learnt: Annotated[
        Path | None, written_file("FILE.yaml", "With --online: coefficients learnt by the end.")
    ] = None

    def own_field(self, flight: "MagneticFlight", known: "Array") -> "Array":
        """Return (N,) nT what the vehicle adds, given what is not the vehicle's, and write what
        was learnt; raises InputError."""
        from isogal.magnetics.compensation import read_compensation
        from isogal.magnetics.online import learn_along

        if self.learnt is not None and not self.online:
            raise InputError("--learnt: only with --online")
        start = None if self.coefficients is None else read_compensation(self.coefficients)
        if self.online:
            found = learn_along(flight.readings, known, start)
            if self.learnt is not None:
                found.compensation.write(self.learnt)
            return found.own
        if start is None:
            raise InputError("give --coefficients, or --online for a vehicle that is not known")
        return start.own_field(flight.readings)


@app.command()
@with_groups
def compensate(
    chosen: FlightChoice,
    vehicle: Coefficients,
    out: Annotated[Path, written_file("FILE.csv", "Track with the anomaly as value.")],
    json: Json = False,
) -> None:
    """Take the vehicle's own field and the Earth's main field off a flight: what is left is the
    anomaly, a track for isogal match --reduction main-field."""
    import numpy as np

    from isogal.magnetics.flight import write_compensated

    flight = chosen.read()
    main_field = flight.main_field(chosen.epoch, chosen.height)
    own = vehicle.own_field(flight, main_field)
    total = flight.readings.total - own
    write_compensated(out, flight, total, total - main_field)
    count, least, most = len(total), float(np.nanmin(own)), float(np.nanmax(own))
    found: dict[str, JsonValue] = {
        "readings": count,
        "without": int(np.isnan(total).sum()),
        "own_field": [least, most],
        "file": str(out),
    }
    line = f"{count} readings, the vehicle's field from {least:.1f} to {most:.1f} nT"
    print_result(found, json, line, str(out))
