"""The command ``isogal`` as a process, as a user starts it."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterable

PATIENCE = 240.0
"""s."""


NO_FIGURES = "from isogal.evaluation.figures import style; style.png = lambda *_: b''; "
"""To draw takes longer than a short run."""


def command(*words: object, figures: bool = True) -> list[str]:
    """The command line of ``isogal`` with some arguments."""
    code = "from isogal.cli.main import main; main()"
    return [sys.executable, "-c", code if figures else NO_FIGURES + code, *map(str, words)]


def sets(overrides: Iterable[str]) -> list[str]:
    """The options that override keys of a scenario."""
    return [word for item in overrides for word in ("--set", item)]


def isogal(
    *words: object, environment: dict[str, str] | None = None, figures: bool = True
) -> subprocess.CompletedProcess:
    """Run ``isogal`` to its end."""
    return subprocess.run(
        command(*words, figures=figures),
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


def wait_for(condition: Callable[[], object], what: str, every: float = 0.05) -> None:
    """Wait until a condition holds, which is asked for every so many seconds."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(every)
