"""Worse starts and late readings by a bank that knows that it is one of the two, and how large:
docs/evidence/wrong-assumptions.md.

    python benchmarks/either.py [options of acceptance.py]

On a straight track both are the same error. What this bank loses against the bounds, which know
which of the two it is, no other can save."""

import sys
from unittest.mock import patch

import acceptance

from isogal.matching.pmht import hypotheses, matcher, models

ROWS = "initial errors 3 times larger", "readings 20 s late$"
FAULTS = (
    models.Fault(models.NONE, 1e-9),  # has to be there
    models.Fault(models.NAVIGATOR, 0.5, start=9.0),
    models.Fault(models.LATE, 0.5, delay=models.LATE_S),
)


def main() -> None:
    """Measure and print the two rows, kept apart from those of `make accept`."""
    with (
        patch.object(models, "FAULTS", FAULTS),
        patch.object(hypotheses, "CREDIBLE", 0.0),  # both count from the beginning
        patch.object(matcher, "pursued", lambda diverged, *_: diverged),  # and nothing else
        patch.object(acceptance, "version", lambda: "either"),
    ):
        acceptance.main(["--again", "--rows", *ROWS, *sys.argv[1:]])


if __name__ == "__main__":
    main()
