"""A gradiometer whose map, platform and components err, which is specified or not
(docs/evidence/gradiometer.md).

    python benchmarks/gradiometer.py [--runs 16] [--first 0] [--case TEXT ...] [--out DIR]

Ratio is the RMS error of all scans after the first half hour over the RMS bound of that world at
the same scans."""

from pathlib import Path

import closed_loop

from isogal.scenario import load_scenario

BASE = (
    "field=gradient",
    "gradiometer.sigma_eotvos=2",
    "gravity.field=normal",
    "route.duration=7200",
    "matcher.batch_length=15",
    "map_error.sigma=5e-9",
    "map_error.correlation_length=1000",
    "matcher.map_sigma=5e-9",
    "matcher.map_correlation_length=1000",
)
POTENTIAL = ("map_errors=one_potential",)
TILT = ("platform_tilt=5e-3", "platform_time=3600")
LESS = ("platform_tilt=1e-3", "platform_time=3600")
FIXED = ("platform_tilt=5e-3", "platform_time=1e9")
FAR = ("platform_tilt=2e-2", "platform_time=1e9")
FAST = ("platform_tilt=1e-3", "platform_time=200")
OFFSET = ("bias_eotvos=5",)
WALK = ("bias_walk_eotvos=0.1",)
CASES = {
    "nothing more": ((), ()),
    "map errors of one potential": (POTENTIAL, ()),
    "platform tilted by 1 mrad, over an hour": (LESS, POTENTIAL),
    "the same, over 200 s": (FAST, POTENTIAL),
    "platform tilted by 5 mrad, for good": (FIXED, POTENTIAL),
    "the same, over an hour": (TILT, POTENTIAL),
    "platform tilted by 20 mrad, for good": (FAR, POTENTIAL),
    "offsets of 5 E": (OFFSET, POTENTIAL),
    "offsets that walk, 6 E in an hour": (WALK, POTENTIAL),
    "all, and 1 mrad over an hour": ((*LESS, *OFFSET, *WALK), POTENTIAL),
}
"""Keys of the gradiometer that are told or not, and keys that are told in any case."""
SETTLED = 1800.0
"""s, from when on errors count."""
COLUMNS = {
    "RMS, m": "{rms:.1f}",
    "bound, m": "{bound:.1f}",
    "ratio": "{ratio:.2f} ± {ratio_error:.2f}",
    "NEES": "{nees_settled:.2f}",
    "at all scans": "{nees_all_scans:.2f}",
    "ms per fix": "{fix_ms:.0f}",
}


def settings_of(case: str, kind: str) -> list[str]:
    """Return the settings of a case whose errors are told or not."""
    keys, always = CASES[case]
    section = "gradiometer" if kind == "told" else "truth.gradiometer"
    known = (f"gradiometer.{key}" for key in always)
    return [*BASE, *known, *(f"{section}.{key}" for key in keys)]


def main() -> None:
    """Run all cases and print a table."""
    out = Path("out/gradiometer")
    parser = closed_loop.parser(__doc__, "case", "workers", runs=16, out=out)
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    options = parser.parse_args()
    cases = {
        (name, kind): load_scenario(None, settings_of(name, kind))
        for name, (keys, _) in CASES.items()
        for kind in ("told", "untold")
        if closed_loop.matching(name, options.case) and (kind == "told" or keys)
    }
    closed_loop.study(("what errs", ""), cases, COLUMNS, options, settled=SETTLED)


if __name__ == "__main__":
    main()
