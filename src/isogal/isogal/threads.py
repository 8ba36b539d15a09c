"""How many cores there are, and how many threads linear algebra takes: one in Isogal's own
programs, whose matrices are too small to share.

A program that uses the library decides for itself: nothing is set when `isogal` is imported.
"""

import os
import sys
from collections.abc import MutableMapping

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by the libraries under NumPy when these are loaded."""


def available_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0))


def one_thread(environment: MutableMapping[str, str] | None = None) -> None:
    """Ask for one thread, unless the user has asked for any number.

    Parameters
    ----------
    environment : mapping, optional
        Of a process to be started. None = of this process; left alone once NumPy is loaded, since
        only others would still see it.
    """
    if environment is None:
        if "numpy" in sys.modules:
            return
        environment = os.environ
    if not any(environment.get(name) for name in VARIABLES):
        environment.update(dict.fromkeys(VARIABLES, "1"))
