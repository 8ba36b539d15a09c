"""Processes in which numba is loaded but no kernel is: forks of one that has imported
`isogal.compiled` and nothing more, which saves each the second that numba takes to begin."""

import json
import os
import subprocess
import sys
from typing import Any

_SERVER = """
import json, os, sys
import isogal.compiled
from numba import njit
from numba.core import config

njit(lambda x: x + 1.0)(1.0)  # what numba does at the first compilation, which takes as long
for line in sys.stdin:
    asked = json.loads(line)
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(writes, 1)
        os.dup2(writes, 2)
        os.environ.clear()
        os.environ.update(asked["environment"])
        config.reload_config()
        sys.path.insert(0, asked["folder"])
        status = 1
        try:
            exec(asked["code"], {"__name__": "__main__"})
            status = 0
        except BaseException:
            import traceback
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    os.close(writes)
    with os.fdopen(reads) as stream:
        said = stream.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    print(json.dumps([status, said]), flush=True)
"""


class Fresh:
    """Starts such processes, one after the other."""

    def __init__(self) -> None:
        self.server = subprocess.Popen(
            [sys.executable, "-B", "-c", _SERVER],
            env={k: v for k, v in os.environ.items() if not k.startswith("NUMBA")},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def run(self, folder: Any, code: str, environment: dict[str, str]) -> str:
        """Return what the code says, with a folder first on the path of modules."""
        asked = {"folder": str(folder), "code": code, "environment": environment}
        assert self.server.stdin is not None
        assert self.server.stdout is not None
        print(json.dumps(asked), file=self.server.stdin, flush=True)
        status, said = json.loads(self.server.stdout.readline())
        assert status == 0, said
        return str(said)

    def close(self) -> None:
        """End the process that the others are forks of."""
        self.server.communicate(timeout=10)
