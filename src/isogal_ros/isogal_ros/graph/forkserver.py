"""Processes of nodes, forked from one interpreter that has imported what they need
(multiprocessing's forkserver): five that each import it for themselves take three times as long.

This module imports little, so that a command starts the interpreter before it imports anything
itself."""

import importlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import forkserver, resource_tracker
from pathlib import Path

from isogal_ros.nodes.signals import end_at_once

_CONTEXT = multiprocessing.get_context("forkserver")


def start() -> None:
    """Start the interpreter, which imports meanwhile what nodes need."""
    with _without_interrupts():
        _CONTEXT.set_forkserver_preload(["__main__", "isogal_ros.graph.preloaded"])
        forkserver.ensure_running()


class NodeProcess:
    """One node in a process of its own.

    Parameters
    ----------
    name : str
        What the process is called.
    module : str
        Of the node; its `main` is called.
    arguments : sequence of str
        Of the node's command line.
    environment : mapping
        The whole of it.
    log : Path
        File that what it says is appended to.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        log: Path,
    ) -> None:
        start()
        words = name, module, list(arguments), dict(environment), log
        self._process = _CONTEXT.Process(target=_be_node, args=words, name=name, daemon=True)
        with _without_interrupts():
            self._process.start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid or 0

    def poll(self) -> int | None:
        """Return the exit code, the negative number of a signal that has killed it; None while it
        runs."""
        return self._process.exitcode

    def wait(self) -> None:
        """Wait for its end."""
        self._process.join()

    def send_signal(self, number: int) -> None:
        """Send a signal to it, if it runs."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Block SIGINT in processes that are started here: a terminal sends Ctrl-C to all, and the
    command alone deals with it."""
    resource_tracker.ensure_running()  # with the first process this would let it through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _be_node(
    name: str, module: str, arguments: list[str], environment: dict[str, str], log: Path
) -> None:
    """Be the process of a node, from here to its end."""
    os.setsid()  # so that Ctrl-C in the terminal reaches the command only
    end_at_once()
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    said = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    os.dup2(said, 1)
    os.dup2(said, 2)
    os.environ.clear()
    os.environ.update(environment)
    Path("/proc/self/comm").write_text(name)  # as ps and top show it
    sys.argv = [name, *arguments]
    importlib.import_module(module).main()
