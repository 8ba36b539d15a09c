"""What a command says on the standard error stream, and how it ends when it cannot go on: with one
clear line and an exit status, without a traceback."""

import errno
import functools
import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import NoReturn, ParamSpec, TypeVar

from isogal.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")

BAD_INPUT = 2
INTERRUPTED = 130  # 128 + SIGINT, as a shell reports it
BROKEN_PIPE = 141  # 128 + SIGPIPE


EXTRAS = {
    "rasterio": "maps",
    "ppigrf": "survey",
    "dask": "dask",
    "distributed": "dask",
    "bokeh": "view",
    "PIL": "view",
    "filterpy": "reference",
    "mcap": "bags",
    "mcap_ros2": "bags",
    "zstandard": "bags",
    "pymavlink": "mavlink",
    "pyshtools": "models",
}
"""Packages that a plain installation does without, and the extra that brings each along."""


class Interrupts:
    """Raises KeyboardInterrupt on Ctrl-C, as Python does, and on SIGTERM and SIGHUP, which would
    leave workers and half-written files behind; remembers that it came, as libraries may make an
    error of their own of it (pydantic, while it builds a model)."""

    came = False

    def __call__(self, _number: int, _frame: FrameType | None) -> NoReturn:
        """Handle a signal."""
        self.came = True
        # where it cannot be raised, as while objects are freed, Python would print it
        sys.unraisablehook = lambda _: None
        raise KeyboardInterrupt


_interrupts = Interrupts()


def remember_interrupts() -> None:
    """Take Ctrl-C, SIGTERM, and SIGHUP of a terminal that is closed, unless whoever has started
    this process ignores them, as `nohup` does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupts)


def note(message: str) -> None:
    """Print ``isogal: message`` as one line on the standard error stream."""
    print(f"isogal: {' '.join(message.split())}", file=sys.stderr)


def fail(message: str, status: int = BAD_INPUT) -> NoReturn:
    """Print ``isogal: message`` as one line on the standard error stream and exit."""
    note(message)
    raise SystemExit(status)


def clean_errors(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that ends with one line, without a traceback, where a user causes it to
    fail.

    InputError, a package that is not installed, and a file that cannot be read or written, exit
    with status 2, an interrupt (`remember_interrupts`) with 130, a closed pipe (``isogal
    ... | head``) silently with 141.
    Everything else is a defect of Isogal and keeps its traceback."""

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except InputError as error:
            fail(str(error))
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in EXTRAS:
                raise
            fail(
                f"this needs the Python package {package}: pip install 'isogal[{EXTRAS[package]}]'"
            )
        except KeyboardInterrupt:
            fail("interrupted", INTERRUPTED)
        except (BrokenPipeError, SystemExit) as end:
            # rich, which writes the help, makes status 1 of a closed pipe
            if isinstance(end, SystemExit) and not isinstance(end.__context__, BrokenPipeError):
                raise
            _discard_stdout()
            raise SystemExit(BROKEN_PIPE) from None
        except OSError as error:
            if error.filename is not None:
                fail(f"{os.fspath(error.filename)}: {error.strerror}")
            if error.errno == errno.ENOSPC:
                fail(f"the output cannot be written: {error.strerror}")
            raise
        except Exception:
            if _interrupts.came:
                fail("interrupted", INTERRUPTED)
            raise

    return wrapper


def _discard_stdout() -> None:
    """Keep the interpreter from flushing into the closed pipe at exit."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)
