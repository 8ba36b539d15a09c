"""The paper's rows in its own world, and in one where the IMU senses the real gravity vector.

    python benchmarks/felt_gravity.py --map FILE [--runs 24] [--workers 2]
        [--page docs/evidence/gravity-vector.md]

Standard aiding every 30 scans on an exact map, as in the paper. Prints a table of RMS errors, and
puts it into a page between its marks."""

import closed_loop
import numpy as np

from isogal.arrays import Array
from isogal.evaluation.records import Runs
from isogal.scenario import Scenario, load_scenario

ROWS = {
    "gravity, 1 mGal": ("gravimeter.quantity=gravity", "gravimeter.sigma=1e-5"),
    "gravity, 20 mGal": ("gravimeter.quantity=gravity", "gravimeter.sigma=2e-4"),
    "disturbance, 0.1 mGal": ("gravimeter.quantity=disturbance", "gravimeter.sigma=1e-6"),
    "disturbance, 4 mGal": ("gravimeter.quantity=disturbance", "gravimeter.sigma=4e-5"),
}
MATCHERS = ("pmht-paper", "pmht")
WORLDS = {
    "normal gravity": ("gravity.field=normal",),
    "sensed, compensated": ("gravity.field=map",),
    "sensed, not compensated, specified": (
        "gravity.field=map",
        "gravity.compensation=none",
    ),
    "sensed, not specified": ("gravity.field=normal", "truth.gravity.field=map"),
}
COMMON = ("matcher.batch_length=30", "matcher.stride=30", "matcher.map_sigma=0")
COLUMNS = {
    "unaided (m)": "{unaided:.0f}",
    "RMS after 1 h (m)": "{rms:.1f}",
    "NEES at all scans": "{nees_all_scans:.3g}",
    "good": "{good_percent:.0f} %",
}
MARKS = closed_loop.marks_of(__file__)


def no_bound(_scenario: Scenario, record: Runs) -> Array:
    """Return NaN: nothing is compared with a bound here."""
    return np.full(record.time.shape, np.nan)


def main() -> None:
    """Measure and print."""
    parser = closed_loop.parser(__doc__, "workers", "page", runs=24)
    parser.add_argument("--map", required=True, help="of gravity and the disturbance")
    options = parser.parse_args()
    cases = {}
    for row, readings in ROWS.items():
        for matcher in MATCHERS:
            for world, gravity in WORLDS.items():
                keys = [*COMMON, *readings, *gravity, f"matcher.name={matcher}"]
                scenario = load_scenario(None, [*keys, f"map.source={options.map}"])
                cases[row, f"`{matcher}`", world] = scenario
    head = ("readings", "matcher", "world")
    table = closed_loop.study(head, cases, COLUMNS, options, bound=no_bound)
    closed_loop.write_between(options.page, MARKS, f"{options.runs} runs of each:\n\n{table}")


if __name__ == "__main__":
    main()
