"""Satellites for an hour, then none: what is left of them beside the bound of that world.

    python benchmarks/voyage.py --data DIR [--runs 40] [--page docs/evidence/voyage.md]

The README's rows with a satellite receiver that works for the first hour of 3.6; and what readings
show while it does of an instrument that is late or has a filter, which nobody has told: beside the
bound of a navigator that knows it. Errors are of the time without satellites, which is that after
the first hour."""

from pathlib import Path

import closed_loop  # first: it asks NumPy for one thread
from acceptance_rows import AUSTRALIA, GOOD, MAPS, READINGS

from isogal.scenario import Scenario, load_scenario

MARKS = closed_loop.marks_of(__file__)
SATELLITES = ["gnss.available=[[0, 3600]]"]
LEARNT = {
    "low-pass of 30 s": ["truth.gravimeter.filter_time=30"],
    "late by 20 s": ["truth.gravimeter.delay=20"],
    "clock off by 2 s": ["truth.gravimeter.delay=2"],
}
COLUMNS = {
    "RMS, m": "{rms:.1f}",
    "bound, m": "{bound:.1f}",
    "ratio": "{ratio:.2f} ± {ratio_error:.2f}",
    "NEES": "{nees:.2f}",
    "unaided INS, m": "{unaided:.0f}",
    "ms a fix": "{fix_ms:.1f}",
}


def cases(data: str, seed: int) -> dict[tuple[str, ...], Scenario]:
    """Return the scenario of each row."""
    common = [f"map.source={data}", f"seed={seed}", *SATELLITES]
    found = {
        (f"{name}, map {error}", "nothing told"): load_scenario(None, [*readings, *wrong, *common])
        for error, (wrong, _) in MAPS.items()
        for name, readings in READINGS.items()
    }
    return found | {
        (f"gravity 1 mGal, {name}", "nothing told"): load_scenario(None, [*GOOD, *keys, *common])
        for name, keys in LEARNT.items()
    }


def main() -> None:
    """Run it."""
    options = closed_loop.parser(__doc__, "data", "page", "rows", "workers", runs=40)
    options.add_argument("--seed", type=int, default=20261)
    options.add_argument("--out", type=Path, help="folder of the results")
    asked = options.parse_args()
    rows = cases(str(asked.data / AUSTRALIA), asked.seed)
    wanted = {
        names: one for names, one in rows.items() if closed_loop.containing(names[0], asked.rows)
    }
    table = closed_loop.study(["readings", "told"], wanted, COLUMNS, asked)
    text = f"{asked.runs} runs a row.\n\n{table}"
    closed_loop.write_between(asked.page, MARKS, text, seed=asked.seed)


if __name__ == "__main__":
    main()
