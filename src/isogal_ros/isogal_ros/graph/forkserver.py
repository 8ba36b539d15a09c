"""Processes of nodes (`isogal.forkserver`): five that each import what they need take twice the
processor time.

This module imports little, so that a command starts the interpreter before it imports anything
itself."""

import importlib
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from multiprocessing.forkserver import ensure_running
from multiprocessing.process import BaseProcess
from pathlib import Path

from isogal.forkserver import CONTEXT, interrupts_blocked, preload
from isogal_ros.nodes.signals import end_at_once


def start() -> None:
    """Start the interpreter, which imports meanwhile what nodes need."""
    preload("isogal_ros.graph.preloaded")
    # it has to outlive SIGTERM: without it nobody knows how a node ends
    with interrupts_blocked(signal.SIGTERM):
        ensure_running()


def start_node(
    name: str,
    module: str,
    arguments: Sequence[str],
    environment: Mapping[str, str],
    log: Path,
) -> BaseProcess:
    """Start the process of a node, and return it.

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
    start()
    words = name, module, list(arguments), dict(environment), log
    process = CONTEXT.Process(target=_be_node, args=words, name=name, daemon=True)
    with interrupts_blocked():
        process.start()
    return process


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
