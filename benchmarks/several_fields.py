"""What two fields bring against each alone, over the same ground, with the same random numbers.

    python benchmarks/several_fields.py --data DIR --out DIR [--runs 16] [--cases TEXT ...]
        [--page docs/evidence/several-fields.md]

DIR of `--data` holds `kalgoorlie_gravity_magnetic.nc`: measured maps of the Bouguer anomaly, which
is taken for the disturbance here, and of the magnetic anomaly. A case is a closed loop of so many
runs of two hours, with gravity, with magnetics, and with both. RMS errors and the bound are over
the time after the first hour. Runs that are in `--out` are not computed again; after a change of
the library, begin with an empty folder."""

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import closed_loop

from isogal.files import write_atomic
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map
from isogal.scenario import Scenario, validate_scenario

Section = dict[str, float | dict[str, float]]
"""Keys of a scenario, or of an entry of its list of fields."""
MARKS = closed_loop.marks_of(__file__)
BASE = {
    "route": {
        "start": [-31.9, 121.0], "end": [-30.3, 122.2], "speed": 22.0, "duration": 7200.0,
        "height": 100.0,
    },
    "gravity": {"field": "normal"},
    "map": {"continuation": "none"},
}  # fmt: skip


def _wrong(sigma: float, told: float | None = None) -> Section:
    """Return the keys of a map in error by a 1-sigma, which is told unless another is."""
    return {
        "map_error": {"sigma": sigma},
        "matcher": {"map_sigma": sigma if told is None else told},
    }


@dataclass(frozen=True)
class Case:
    """Keys of both entries, and of the scenario."""

    name: str
    gravity: Section
    magnetic: Section
    more: Section = field(default_factory=dict)


_GRAVITY, _MAGNETIC = {"sigma": 1e-6}, {"sigma": 10.0}
ALIKE = _GRAVITY | _wrong(1e-6), _MAGNETIC | _wrong(30.0)
CASES = (
    Case("both alike, told", *ALIKE),
    Case(
        "both alike, nothing told",
        _GRAVITY | {"map_error": {"sigma": 1e-6}},
        _MAGNETIC | {"map_error": {"sigma": 30.0}},
    ),
    Case("exact maps", _GRAVITY | _wrong(0.0), {"sigma": 20.0} | _wrong(0.0)),
    Case("magnetics far better", {"sigma": 1e-5} | _wrong(3e-6), {"sigma": 2.0} | _wrong(10.0)),
    Case("gravity far better", ALIKE[0], {"sigma": 50.0} | _wrong(150.0)),
    Case("magnetometer every 4 s", ALIKE[0], ALIKE[1] | {"interval": 4.0}),
    Case("start known to 5 km", *ALIKE, {"initial_error": {"position": 5000.0}}),
    Case("magnetic map twice as wrong as told", ALIKE[0], _MAGNETIC | _wrong(30.0, 15.0)),
)
"""1-sigmas: gravity in m/s² (1e-6 is 0.1 mGal), magnetics in nT."""


def scenarios(case: Case, data: Path, out: Path) -> dict[str, Scenario]:
    """Return the scenario of each alone and of both; the random streams are the same."""
    source = data / "kalgoorlie_gravity_magnetic.nc"
    disturbance = out / "disturbance.nc"
    if not disturbance.exists():
        out.mkdir(parents=True, exist_ok=True)
        bouguer = load_map(source, "bouguer_anomaly")
        write_netcdf(replace(bouguer, quantity="disturbance"), disturbance)
    first = {"field": "disturbance", "map": {"source": str(disturbance)}} | case.gravity
    second = {
        "field": "magnetic",
        "map": {"source": str(source), "variable": "magnetic_anomaly"},
    } | case.magnetic
    base = BASE | case.more
    both = validate_scenario(base | {"fields": [first, second]})
    second["seed"] = both.each_field[1].seed
    alone = {"gravity": first, "magnetics": second}
    return {name: validate_scenario(base | {"fields": [one]}) for name, one in alone.items()} | {
        "both": both
    }


HEAD = (
    *("case", "gravity", "magnetics", "both", "both / better one"),
    *("its bound / better one's", "NEES of both"),
)


def cells(one: dict[str, closed_loop.Figures]) -> list[str]:
    """Return the cells of a case: errors with their ratio to the bound, then what both bring."""
    alone, both = (one["gravity"], one["magnetics"]), one["both"]
    gains = [both[name] / min(figures[name] for figures in alone) for name in ("rms", "bound")]
    errors = [f"{x['rms']:.1f} ({x['ratio']:.2f})" for x in (*alone, both)]
    return [*errors, *(f"{gain:.2f}" for gain in (*gains, both["nees"]))]


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute the cases, print the table, and write it into a page."""
    parser = closed_loop.parser(__doc__, "data", "out", "workers", "page", runs=16)
    parser.add_argument("--cases", nargs="*", metavar="TEXT", help="with TEXT in their name")
    options = parser.parse_args(arguments)
    results = {}
    with ProcessPoolExecutor(options.workers) as pool:
        for case in CASES:
            if not closed_loop.containing(case.name, options.cases):
                continue
            one = results[case.name] = {}
            for name, scenario in scenarios(case, options.data, options.out).items():
                record = closed_loop.kept_runs(scenario, options.runs, options.out, pool)
                bound = closed_loop.bound_of(scenario, record)
                one[name] = closed_loop.figures_of(scenario, record, bound)
            print(closed_loop.line_of([case.name, *cells(one)]), flush=True)
    rows = ([name, *cells(one)] for name, one in results.items())
    text = f"{options.runs} runs of each; m, and in brackets times the bound of the same fields."
    text += f"\n\n{closed_loop.markdown(HEAD, rows)}"
    print(text)
    write_atomic(options.out / "several_fields.json", json.dumps(results, indent=1))
    closed_loop.write_between(options.page, MARKS, text)


if __name__ == "__main__":
    main()
