"""The interpreter of which processes are forked ends with who has started it."""

import subprocess
import sys
import time


def test_it_imports_nothing_more_once_nobody_needs_it(tmp_path):
    (tmp_path / "takes_long.py").write_text("import time; time.sleep(30.0)")
    code = """
from multiprocessing.forkserver import ensure_running
from isogal.forkserver import interrupts_blocked, preload
preload("takes_long")
with interrupts_blocked():
    ensure_running()
raise SystemExit(130)
"""
    begun = time.monotonic()
    # until the last process that has the pipes has ended
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (130, "")
    assert time.monotonic() - begun < 20.0
