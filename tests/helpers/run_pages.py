"""Run what the documentation shows: `make test-docs`.

    python tests/helpers/run_pages.py PAGE ...

The commands of each page, one after the other as a shell runs them, in a folder of its own that
has what the repository has; ends with 1 if one of them fails. Pages but the README and tutorials
are run with the smaller numbers that they name. A page may use ``$ROOT``, the repository, and
``$SHARED``, the test data beside it; without these the page is left out. What a page installs with
``pip install --target out/installed`` is found."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"
INSTALLED = "out/installed"
LINKED = ("examples", "docs", "src", "bags", "Makefile")
"""What is linked into the folder."""


def run(page: Path) -> bool:
    """Run the commands of a page and say how it went."""
    from helpers.pages import commands

    whole = page.name == "README.md" or page.parent.name == "tutorials"
    lines, begun = commands(page, short=not whole), time.monotonic()
    if not SHARED.is_dir() and any("$SHARED" in line for line in lines):
        print(f"{page.name}: left out, {SHARED} is not there", flush=True)
        return True
    environment = os.environ | {
        "PATH": f"{ROOT / '.venv' / 'bin'}:{os.environ['PATH']}",
        "ROOT": str(ROOT),
        "SHARED": str(SHARED),
    }
    with tempfile.TemporaryDirectory() as folder:
        environment["PYTHONPATH"] = str(Path(folder) / INSTALLED)
        for name in LINKED:
            (Path(folder) / name).symlink_to(ROOT / name)
        for line in lines:
            print(f"{page.name}: {line}", flush=True)
            done = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", line],
                check=False,
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
            )
            if done.returncode:
                print(done.stdout[-2000:], done.stderr[-2000:], f"status {done.returncode}")
                return False
    if lines:
        seconds = time.monotonic() - begun
        print(f"{page.name}: {len(lines)} commands, {seconds:.0f} s", flush=True)
    return True


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "tests"))
    good = [run(Path(name)) for name in sys.argv[1:]]
    sys.exit(0 if all(good) else 1)
