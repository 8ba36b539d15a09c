"""Processes that are forked from one interpreter which has imported what they need
(multiprocessing's forkserver): each starts in a moment."""

import atexit
import multiprocessing
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import forkserver, resource_tracker

CONTEXT = multiprocessing.get_context("forkserver")


def preload(module: str) -> None:
    """Have the interpreter, unless it has been started, import the program and a module."""
    CONTEXT.set_forkserver_preload(["__main__", module])


@contextmanager
def interrupts_blocked(*others: signal.Signals) -> Iterator[None]:
    """Block Ctrl-C, and other signals, in processes that are started here: a terminal sends it to
    the whole group (service managers and `timeout` SIGTERM), and this process alone deals with
    it."""
    resource_tracker.ensure_running()  # with the first process this would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, *others})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@atexit.register
def _end_server() -> None:
    """End the interpreter with this process: where that is interrupted early, it would go on for
    seconds to import what nobody needs any more."""
    server: object = vars(forkserver)["_forkserver"]
    pid = getattr(server, "_forkserver_pid", None)
    if pid is not None and not multiprocessing.active_children():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)  # which cannot be blocked
