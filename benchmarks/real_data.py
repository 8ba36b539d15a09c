"""Measured data: gravity stations at Clear Lake and aeromagnetic lines over Scotland, matched.

    python benchmarks/real_data.py [DATA] [--out DIR] [--json]
    python benchmarks/real_data.py [DATA] --kept | --untold

DATA (default ../shared/data) holds the two maps and the readings that were not used for them;
docs/evidence/real-data.md describes them and shows the results. Nothing is tuned on what it is
reported on: correlation length and sensor noise for a line at Clear Lake come from the other
lines, those for the tie lines of Scotland from its flight lines."""

import json
from pathlib import Path

import closed_loop
from measured_data.clear_lake import study_clear_lake
from measured_data.kept import study_kept
from measured_data.scotland import study_scotland
from measured_data.tables import tables, untold_table
from measured_data.untold import study_untold

STUDIES = {
    "--untold": (study_untold, "with nothing told"),
    "--kept": (study_kept, "lines kept from maps of every set, beside the reference"),
}
"""That are asked for by an option each."""


def main() -> None:
    parser = closed_loop.parser(__doc__, "json")
    parser.add_argument(
        "data", nargs="?", type=Path, default=Path("../shared/data"), help="folder of the data"
    )
    parser.add_argument("--out", type=Path, help="write the results there as real_data.json")
    for name, (_, what) in STUDIES.items():
        parser.add_argument(name, action="store_true", help=f"only {what}")
    options = parser.parse_args()
    if not options.data.is_dir():
        parser.error(f"{options.data}: no such folder; name the folder of the data")
    for name, (study, _) in STUDIES.items():
        if getattr(options, name[2:].replace("-", "_")):
            found = study(options.data)
            print(json.dumps(found, indent=1) if options.json else untold_table(found))
            return
    results = {
        "untold": study_untold(options.data),
        "clear_lake": study_clear_lake(options.data),
        "scotland": study_scotland(options.data),
    }
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "real_data.json").write_text(json.dumps(results, indent=1))
    print(json.dumps(results) if options.json else tables(**results))


if __name__ == "__main__":
    main()
