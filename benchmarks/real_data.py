"""Measured data: gravity stations at Clear Lake and aeromagnetic lines over Scotland, matched.

    python benchmarks/real_data.py [DATA] [--out DIR] [--figures DIR] [--json]
    python benchmarks/real_data.py [DATA] --untold | --gridded | --left-out | --exact

DATA (default ../shared/data) holds the two maps and the readings that were not used for them;
docs/evidence/real-data.md describes them and shows the results. Nothing is tuned on what it is
reported on: correlation length and sensor noise for a line at Clear Lake come from the other
lines, those for the tie lines of Scotland from its flight lines."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import json
from pathlib import Path

from measured_data.clear_lake import study_clear_lake
from measured_data.exact import study_exact
from measured_data.figures import write_figures
from measured_data.scotland import study_scotland
from measured_data.tables import tables, untold_table
from measured_data.untold import study_gridded, study_left_out, study_untold


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "data", nargs="?", type=Path, default=Path("../shared/data"), help="folder of the data"
    )
    parser.add_argument("--out", type=Path, help="write the results there as real_data.json")
    parser.add_argument("--figures", type=Path, help="write the figures there")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    parser.add_argument("--untold", action="store_true", help="only with nothing told")
    parser.add_argument("--gridded", action="store_true", help="only on maps made of the surveys")
    parser.add_argument("--left-out", action="store_true", help="only lines of the survey itself")
    parser.add_argument("--exact", action="store_true", help="only the likelihood by kriging")
    options = parser.parse_args()
    if not options.data.is_dir():
        parser.error(f"{options.data}: no such folder; name the folder of the data")
    if options.exact:
        print(json.dumps(study_exact(options.data), indent=1))
        return
    if options.untold or options.gridded or options.left_out:
        studies = (study_untold, study_gridded, study_left_out)
        asked = (options.untold, options.gridded, options.left_out)
        untold = studies[asked.index(True)](options.data)
        print(json.dumps(untold) if options.json else untold_table(untold))
        return
    results = {
        "untold": study_untold(options.data),
        "clear_lake": study_clear_lake(options.data),
        "scotland": study_scotland(options.data),
    }
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "real_data.json").write_text(json.dumps(results, indent=1))
    if options.figures:
        write_figures(options.data, results, options.figures)
    print(json.dumps(results) if options.json else tables(results))


if __name__ == "__main__":
    main()
