"""What a command does when it cannot go on: one clear line on the standard error stream and an
exit status, no traceback."""

import errno
import functools
import os
import sys
from collections.abc import Callable
from typing import NoReturn, ParamSpec, TypeVar

from isogal.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")

BAD_INPUT = 2
INTERRUPTED = 130  # 128 + SIGINT, as a shell reports it
BROKEN_PIPE = 141  # 128 + SIGPIPE


def fail(message: str, status: int = BAD_INPUT) -> NoReturn:
    """Print ``isogal: message`` as one line on the standard error stream and exit."""
    print(f"isogal: {' '.join(message.split())}", file=sys.stderr)
    raise SystemExit(status)


def clean_errors(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a command so that what a user can cause ends in one line instead of a traceback.

    InputError, and a file that cannot be read or written, exit with status 2, Ctrl-C with 130, a
    reader that went away (``isogal ... | head``) silently with 141. Everything else is a defect of
    Isogal and keeps its traceback."""

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except InputError as error:
            fail(str(error))
        except KeyboardInterrupt:
            fail("interrupted", INTERRUPTED)
        except BrokenPipeError:
            _discard_stdout()
            raise SystemExit(BROKEN_PIPE) from None
        except OSError as error:
            if error.filename is not None:
                fail(f"{os.fspath(error.filename)}: {error.strerror}")
            if error.errno == errno.ENOSPC:
                fail(f"the output cannot be written: {error.strerror}")
            raise

    return wrapper


def _discard_stdout() -> None:
    """Keep the interpreter from flushing, at exit, into the pipe that nobody reads any more."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)
