"""Workers on this machine, one process each, forked from one new interpreter that has imported all
they need (forkserver). If one dies, another takes its place and its chunk.

Python's own pools give up when a worker is killed, and do not say which task it had; here the
parent holds a pipe to each worker. A script that computes by workers needs the guard ``if __name__
== "__main__"``, since each of them imports it."""

import contextlib
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess

from isogal.maps.several import RunMap
from isogal.montecarlo.chunks import Answer, Chunk, WorkerError, attempt, throttled
from isogal.threads import VARIABLES

ATTEMPTS = 3
"""How often a chunk is begun before it is blamed for the deaths of its workers."""
_THREADS = (*VARIABLES, "NUMBA_NUM_THREADS")

Report = Callable[[Chunk, float], None]
"""Called with a chunk and the simulated time (s) that its runs have reached."""


def serve(connection: Connection, maps: Mapping[str, RunMap]) -> None:
    """Compute the tasks that come through the pipe until the parent closes it: the work of a
    worker process. Numbers that go back are the simulated time reached, all else is an answer."""
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            task = connection.recv()
            connection.send(attempt(task, maps[task.map_key], throttled(connection.send)))


@dataclass(slots=True, eq=False)
class _Worker:
    process: ForkServerProcess
    connection: Connection

    @classmethod
    def start(cls, maps: Mapping[str, RunMap]) -> "_Worker":
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["__main__", __name__])
        ours, theirs = context.Pipe()
        process = context.Process(
            target=serve, args=(theirs, maps), daemon=True, name="isogal-worker"
        )
        with _one_thread(), _interrupts_blocked():
            process.start()
        theirs.close()
        return cls(process, ours)

    def give(self, chunk: Chunk) -> None:
        # a worker that has died is noticed by the end of its pipe
        with contextlib.suppress(ConnectionError):
            self.connection.send(chunk.task)

    def stop(self, patience: float = 0.0) -> int | None:
        """End the process if it does not end by itself within so many seconds; return its exit
        status, or minus the signal that has killed it."""
        self.connection.close()
        self.process.join(patience)
        self.process.kill()
        self.process.join()
        status = self.process.exitcode
        self.process.close()
        return status


def local_results(
    chunks: Sequence[Chunk], maps: Mapping[str, RunMap], workers: int, report: Report
) -> Generator[tuple[Chunk, Answer], None, None]:
    """Compute chunks by so many processes; yields them as they are finished.

    Parameters
    ----------
    chunks : sequence of Chunk
        Begun in this order.
    maps : mapping
        By `map_digest`.
    workers : int
        Processes; each uses one thread.
    report : callable
        Called with the progress of a chunk.

    Raises
    ------
    WorkerError
        The workers of a chunk died `ATTEMPTS` times.
    """
    waiting, begun = list(reversed(chunks)), Counter[Chunk]()
    idle: list[_Worker] = []
    busy: dict[_Worker, Chunk] = {}
    try:
        while waiting or busy:
            while waiting and len(busy) < workers:
                worker = idle.pop() if idle else _Worker.start(maps)
                chunk = waiting.pop()
                busy[worker] = chunk
                begun[chunk] += 1
                worker.give(chunk)
            ready = wait([worker.connection for worker in busy])
            for worker, chunk in [each for each in busy.items() if each[0].connection in ready]:
                try:
                    said = worker.connection.recv()
                except (EOFError, ConnectionError):
                    del busy[worker]
                    status = worker.stop(5.0)
                    if begun[chunk] >= ATTEMPTS:
                        raise WorkerError(f"{chunk}: {_death(status)}") from None
                    waiting.append(chunk)
                    said = 0.0
                if isinstance(said, float):
                    report(chunk, said)
                else:
                    del busy[worker]
                    idle.append(worker)
                    yield chunk, said
    finally:
        for worker in (*idle, *busy):
            worker.stop()


def _death(status: int | None) -> str:
    how = f"ended with status {status}"
    if status is not None and status < 0:
        how = f"was killed by signal {-status} ({signal.Signals(-status).name})"
    hint = "; is there too little memory?" if status == -signal.SIGKILL else ""
    return f"the worker {how}, {ATTEMPTS} times{hint}"


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes started here use one thread each: workers share the cores, and sums within a
    product of matrices keep one order."""
    before = dict(os.environ)
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C, which a terminal sends to the whole group, in processes started here: the
    parent alone handles it."""
    resource_tracker.ensure_running()  # with the first worker this would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
