"""Processes that are forked from one interpreter which has imported what they need
(multiprocessing's forkserver): each starts in a moment."""

import multiprocessing
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

CONTEXT = multiprocessing.get_context("forkserver")


def preload(module: str) -> None:
    """Have the interpreter, unless it has been started, import the program and a module."""
    CONTEXT.set_forkserver_preload(["__main__", module])


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in processes that are started here: a terminal sends it to the whole group, and
    this process alone deals with it."""
    resource_tracker.ensure_running()  # with the first process this would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
