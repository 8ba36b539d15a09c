"""Measured data, matched with nothing told: gravity stations, aeromagnetic lines, ships.

    python benchmarks/real_data.py [DATA] [--json]
    python benchmarks/real_data.py [DATA] --kept [--only TEXT ...] [--workers N] [--page FILE]

DATA (default ../shared/data) holds surveys, maps and readings that were not used for them;
docs/evidence/real-data.md describes them and shows the results. First lines on the maps that come
with them; with --kept lines of every set on maps by `isogal map grid` without them, by the matcher
and by an independent posterior. Maps and posterior are kept in build/real_data for the next time,
by the source of what makes them."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import closed_loop
from measured_data.kept import study_kept
from measured_data.matches import Summary
from measured_data.untold import study_untold

_NAMES = (
    *("error_median_m", "error_90_m", "sigma_long_median_m"),
    *("nees_per_axis", "nees_per_axis_median", "nees_low", "nees_high", "nis"),
)
COLUMNS = {
    "fixes": "{fixes} of {batches}",
    "error, median (km)": "{error_median_km:.2f}",
    "error, 90 %": "{error_90_km:.2f}",
    "1-sigma, median": "{sigma_long_median_km:.2f}",
    "NEES, mean": "{nees_per_axis:.2f}",
    "NEES, median": "{nees_per_axis_median:.2f}",
    "95 % of right ones": "{nees_low:.2f} to {nees_high:.2f}",
    "NIS": "{nis:.2f}",
}


def main() -> None:
    parser = closed_loop.parser(__doc__, "json", "page", "workers")
    parser.add_argument(
        "data", nargs="?", type=Path, default=Path("../shared/data"), help="folder of the data"
    )
    parser.add_argument("--kept", action="store_true", help="lines kept from maps of every set")
    parser.add_argument("--only", nargs="+", help="with --kept: sets with TEXT in their name")
    options = parser.parse_args()
    if not options.data.is_dir():
        parser.error(f"{options.data}: no such folder; name the folder of the data")
    if options.page and (options.only or not options.kept):
        parser.error("--page: shows the whole table of --kept")
    found: Iterator[tuple[str, Summary]] = study_untold(options.data)
    if options.kept:
        found = study_kept(options.data, options.only, options.workers)
    if options.json:
        print(json.dumps(dict(found), indent=1))
        return
    lines = [closed_loop.head_of(["lines", *COLUMNS])]
    print(lines[0], flush=True)
    for name, summary in found:
        lines.append(row(name, summary))
        print(lines[-1], flush=True)
    marks = closed_loop.marks_of("real_data.py")
    closed_loop.write_between(options.page, marks, "\n".join(lines))


def row(name: str, summary: Summary) -> str:
    """Return a line of the table; what a summary has not is a dash."""
    there = {key: value for key, value in summary.items() if value is not None}
    known = dict.fromkeys(_NAMES, math.nan) | there
    known |= {f"{key[:-2]}_km": known[key] / 1e3 for key in known if key[-2:] == "_m"}
    return closed_loop.line_of([name, *closed_loop.cells_of(known, COLUMNS)])


if __name__ == "__main__":
    main()
