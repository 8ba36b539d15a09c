"""The rows of `acceptance.py`: what is simulated or matched, and how many runs of it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import closed_loop
import gradiometer
import mismatch
import mismatch_rows
import multibeam
import several_fields
from measured_data.untold import GROUPS
from mismatch_maps import Maps, coarse_map

from isogal.arrays import Array
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.files import write_atomic
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.scenario import Scenario, load_scenario
from isogal.scenario.loading import changed_scenario

AUSTRALIA, KALGOORLIE = "se_australia_gravity.nc", "kalgoorlie_gravity_magnetic.nc"
SCOTLAND = "scotland_magnetic_map.nc"
FEWER = 16
"""Runs of rows that are not of the README's table."""


@dataclass(frozen=True)
class Place:
    """Where data are, and what all rows have in common."""

    data: Path
    out: Path
    """For maps that are made."""
    seed: int
    matcher: str | None = None
    """None = the default one."""
    changes: tuple[str, ...] = ()
    """Keys of every scenario that are changed, as ``KEY=VALUE``."""


def plain_bound(scenario: Scenario, record: Runs, _place: Place) -> Array:
    """Return (K,) m, the RMS bound at the times of a record."""
    return closed_loop.bound_of(scenario, record)


@dataclass(frozen=True)
class Row:
    """Runs of a scenario in closed loop."""

    name: str
    make: Callable[[Place], Scenario]
    runs: int = FEWER
    quick: bool = False
    """Whether it is one of `--quick`."""
    needs: tuple[str, ...] = (AUSTRALIA,)
    """Files of the data."""
    settled: float = SETTLED_AFTER
    """s, from when on errors count."""
    minutes: tuple[int, ...] = ()
    """When it is asked how many have been found."""
    bound: Callable[[Scenario, Runs, Place], Array] = plain_bound


@dataclass(frozen=True)
class Tracks:
    """Recorded lines, matched with nothing told; a run is a line from one direction."""

    name: str
    group: str
    quick: bool = False
    needs: tuple[str, ...] = ()
    runs: int = 0
    """All lines, always."""


def of_settings(*settings: str) -> Callable[[Place], Scenario]:
    """Return what makes a scenario over the map of south-east Australia."""

    def make(place: Place) -> Scenario:
        return load_scenario(None, [*settings, f"map.source={place.data / AUSTRALIA}"])

    return make


READINGS = {
    "gravity 1 mGal": ["gravimeter.quantity=gravity", "gravimeter.sigma=1e-5"],
    "gravity 20 mGal": ["gravimeter.quantity=gravity", "gravimeter.sigma=2e-4"],
    "disturbance 0.1 mGal": ["gravimeter.quantity=disturbance", "gravimeter.sigma=1e-6"],
    "disturbance 4 mGal": ["gravimeter.quantity=disturbance", "gravimeter.sigma=4e-5"],
}
GOOD, FINE = READINGS["gravity 1 mGal"], READINGS["disturbance 0.1 mGal"]
WRONG_3 = ["map_error.sigma=3e-5"]
MAPS: dict[str, tuple[list[str], list[str]]] = {
    "exact": ([], ["matcher.map_sigma=0"]),
    "3 mGal": (WRONG_3, ["matcher.map_sigma=3e-5"]),
    "8 mGal": (["map_error.sigma=8e-5"], ["matcher.map_sigma=8e-5"]),
}
"""How wrong the map is, and what tells the matcher so."""
OVER_TERRAIN = (
    "field=terrain",
    "map.variable=height",
    "route.height=2500",
    "route.waypoints=[[-36.6,147,22],[-36.24,147,22],[-36.6,147.04,22],[-36.24,147.04,22],"
    "[-36.6,147.08,22]]",
    "route.duration=7200",
    "gravimeter.interval=1",
    "gravimeter.sigma=0.5",
    "map_error.sigma=40",
    "imu.grade=tactical",
    "velocity.kind=dvl",
)
EXACT, TOLD_3 = MAPS["exact"][1], [*WRONG_3, *MAPS["3 mGal"][1]]
BIASED = ["gravimeter.bias=5e-5", "gravimeter.drift=2.8e-9"]
"""5 mGal and 1 mGal per hour, 1-sigma."""


def of_the_readme(known: str) -> list[Row]:
    """Return the rows of the README's table, with nothing told or told."""
    return [
        Row(
            f"{name}, map {error}, {known}",
            of_settings(*readings, *wrong, *(told if known == "told" else ())),
            runs=40,
            quick=known == "nothing told",
        )
        for error, (wrong, told) in MAPS.items()
        for name, readings in READINGS.items()
    ]


def hidden(kilometres: int, *settings: str, duration: int = 5400) -> Callable[[Place], Scenario]:
    """Return what makes a scenario whose start is further off than the navigator believes."""
    off = f"initial_error.hidden_position={1000 * kilometres}"
    return of_settings(*GOOD, *settings, off, f"route.duration={duration}")


def of_gravity() -> list[Row]:
    """Return rows of a biased gravimeter, of hidden and of uncertain starts: nothing told of
    map and readings."""
    found = (30, 45, 60, 75)
    uncertain = "initial_error.position=5000", "route.duration=5400"
    biased = "gravimeter bias 5 mGal, drift 1 mGal/h, map exact, nothing told"
    alone = "imu.grade=tactical", "route.duration=3600"
    return [
        Row(biased, of_settings(*GOOD, *BIASED), runs=40, quick=True),
        # an INS that is lost before an hour is over: honest is all that it can be
        *(
            Row(
                f"tactical INS without a log, map {error}",
                of_settings(*GOOD, *alone, *MAPS[error][0]),
                settled=600.0,
            )
            for error in ("exact", "3 mGal")
        ),
        *(
            Row(
                f"hidden start 10 km, map {error}",
                hidden(10, *MAPS[error][0], duration=duration),
                quick=True,
                minutes=found,
            )
            for error, duration in (("exact", 5400), ("3 mGal", 7200))
        ),
        Row(
            "hidden start 10 km, map exact, bias 8 mGal",
            hidden(10, "truth.gravimeter.bias=8e-5", duration=8100),
            settled=7200.0,
            minutes=(75, 90, 105, 120),
        ),
        Row(
            "tactical INS with a Doppler log, heights of a map 40 m wrong",
            of_settings(*OVER_TERRAIN),
            runs=8,
        ),
        Row(
            "tactical INS without a log, heights of a map 40 m wrong",
            of_settings(*OVER_TERRAIN, "velocity.kind=none", "route.duration=3600"),
            settled=600.0,
        ),
        *(
            Row(
                f"start uncertain by 5 km, map {error}",
                of_settings(*GOOD, *uncertain, *MAPS[error][0]),
                quick=error == "exact",
                minutes=found,
            )
            for error in ("exact", "3 mGal")
        ),
    ]


def _maps(place: Place) -> Maps:
    """Return the maps of `mismatch.py`, made once."""
    kept = place.out / "maps.json"
    if not kept.exists():
        made = coarse_map(place.data, place.out)
        write_atomic(kept, json.dumps(asdict(made)))
    return Maps(**json.loads(kept.read_text(encoding="utf-8")))


def _mismatched(row: mismatch_rows.Row, place: Place) -> Scenario:
    return mismatch.scenario_of(row, "nothing told", mismatch_rows.MGAL_3, _maps(place))


def of_mismatch() -> list[Row]:
    """Return the rows of `mismatch.py` with nothing told."""

    def bound(row: mismatch_rows.Row, scenario: Scenario, record: Runs, place: Place) -> Array:
        return mismatch.bound_of(row, "nothing told", scenario, record, _maps(place))

    return [
        Row(
            f"mismatch: {row.name}",
            partial(_mismatched, row),
            quick=row.name in ("initial errors 3 times larger", "readings 20 s late"),
            needs=(AUSTRALIA, KALGOORLIE),
            bound=partial(bound, row) if row.bound or row.unknown else plain_bound,
        )
        for row in mismatch_rows.ROWS
    ]


def of_tracks() -> list[Tracks]:
    """Return the rows of measured tracks."""
    lake = tuple(f"clear_lake_gravity_{part}.nc" for part in ("map", "stations"))
    scotland = SCOTLAND, "scotland_magnetic_lines.nc"
    return [
        Tracks(
            f"tracks: {group}",
            group,
            quick="4 directions" in group,
            needs=lake if "Lake" in group else scotland,
        )
        for group in GROUPS
    ]


def of_gradients() -> list[Row]:
    """Return rows of a gradiometer: the map's error told, and with nothing told."""
    chosen = {
        "nothing more": ("told", "nothing told"),
        "map errors of one potential": ("told",),
        "the same, over an hour": ("told", "untold"),
        "all, and 1 mrad over an hour": ("told",),
    }
    rows = []
    for case, kinds in chosen.items():
        for kind in kinds:
            settings = gradiometer.settings_of(case, kind.removeprefix("nothing "))
            if kind == "nothing told":
                settings = [text for text in settings if not text.startswith("matcher.map_")]
            name = case.replace("the same", "platform tilted by 5 mrad")
            quick = (case, kind) == ("nothing more", "told")
            rows.append(Row(f"gradiometer: {name}, {kind}", of_settings(*settings), quick=quick))
    return rows


def _over_sea_floor(keys: Sequence[str], place: Place) -> Scenario:
    path = place.out / "sea_floor.nc"
    if not path.exists():
        write_netcdf(multibeam.sea_floor(), path)
    return load_scenario(None, [*multibeam.SCENARIO, f"map.source={path}", *keys])


def of_beams() -> list[Row]:
    """Return the rows of `multibeam.py`."""
    return [
        Row(
            f"beams: {name}",
            partial(_over_sea_floor, keys),
            quick=name.startswith("four beams of"),
            needs=(),
            settled=600.0,
        )
        for name, keys in multibeam.CASES.items()
    ]


def _of_both(case: several_fields.Case, place: Place) -> Scenario:
    with_seed = replace(case, more=case.more | {"seed": place.seed})
    return several_fields.scenarios(with_seed, place.data, place.out)["both"]


def of_several() -> list[Row]:
    """Return rows of gravity and magnetics together."""
    chosen = (
        *("both alike, nothing told", "both alike, told"),
        *("magnetometer every 4 s", "start known to 5 km"),
    )
    return [
        Row(
            f"two fields: {case.name}",
            partial(_of_both, case),
            quick=case.name == chosen[0],
            needs=(KALGOORLIE,),
        )
        for case in several_fields.CASES
        if case.name in chosen
    ]


SQUARE = (
    "field=magnetic",
    "map.variable=magnetic_anomaly",
    "route.waypoints=[[55.85, -4.5, 40], [56.05, -4.5, 40], [56.05, -4.15, 40],"
    " [55.85, -4.15, 40], [55.85, -4.49, 40]]",
    "route.height=500",
    "route.duration=2100",
    "gravity.field=normal",
    "imu.grade=navigation",
    *("gravimeter.sigma=2", "gravimeter.interval=5", "gravimeter.bias=100"),
    *("map_error.sigma=10", "matcher.map_sigma=10", "matcher.bias_sigma=100"),
)
"""22 km a side over Scotland: docs/magnetometer.md, section 7."""
AIRCRAFT = (
    "magnetometer.aircraft.permanent=[132, -88, 165]",
    "magnetometer.aircraft.induced=[2.2e-3, 3.3e-4, -2.2e-4, 1.1e-4, -1.65e-3, 4.4e-4, 3.3e-4,"
    " -1.1e-4, 8.8e-4]",
    "magnetometer.aircraft.eddy=[3.3e-3, 1.1e-3, -2.2e-3, 5.5e-4, 4.4e-3, 1.1e-3, -1.1e-3,"
    " 6.6e-4, 2.2e-3]",
)
"""115 nT from peak to peak."""


def _over_scotland(keys: Sequence[str], place: Place) -> Scenario:
    return load_scenario(None, [*SQUARE, *keys, f"map.source={place.data / SCOTLAND}"])


def of_aircraft() -> list[Row]:
    """Return rows of a magnetic aircraft, with and without calibration."""
    unknown = tuple(f"truth.{text}" for text in AIRCRAFT)
    cases = {
        "no magnetic aircraft": (),
        "aircraft calibrated": AIRCRAFT,
        "aircraft, nothing told": unknown,
        "aircraft, cold start": (*unknown, "magnetometer.online=true"),
    }
    return [
        Row(
            f"magnetic: {name}",
            partial(_over_scotland, keys),
            quick="cold" in name,
            needs=(SCOTLAND,),
            settled=600.0,
        )
        for name, keys in cases.items()
    ]


def of_retrodiction() -> list[Row]:
    """Return rows in which each scan's fix is taken where it was."""
    return [
        Row(
            f"retrodiction: gravity 1 mGal, map {error}, nothing told",
            of_settings(*GOOD, "matcher.mode=retrodiction", *MAPS[error][0]),
            quick=error == "exact",
        )
        for error in ("exact", "3 mGal")
    ]


def all_rows() -> list[Row | Tracks]:
    """Return all rows, what is most important first."""
    return [
        *of_the_readme("nothing told"),
        *of_gravity(),
        *of_mismatch(),
        *of_tracks(),
        *of_the_readme("told"),
        *of_gradients(),
        *of_beams(),
        *of_several(),
        *of_aircraft(),
        *of_retrodiction(),
    ]


def scenario_of(row: Row, place: Place) -> Scenario:
    """Return the scenario of a row, with the seed and the matcher that are asked for."""
    place.out.mkdir(parents=True, exist_ok=True)
    changes = [f"seed={place.seed}", *place.changes]
    if place.matcher is not None:
        changes.append(f"matcher.name={place.matcher}")
    return changed_scenario(row.make(place), changes, row.name)
