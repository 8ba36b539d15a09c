"""Workers on this machine, one process each, forked from one new interpreter that has imported all
they need (forkserver). If one dies, another takes its place and its chunk.

Python's own pools give up when a worker is killed, and do not say which task it had; here the
parent holds a pipe to each worker. A script that computes by workers needs the guard ``if __name__
== "__main__"``, since each of them imports it."""

import contextlib
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess
from typing import Any

from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.maps.several import RunMap
from isogal.montecarlo.chunks import Chunk, compute
from isogal.threads import VARIABLES

ATTEMPTS = 3
"""How often a chunk is begun before it is blamed for the deaths of its workers."""
REPORT_EVERY = 0.2
"""s between a worker's reports of progress."""
_THREADS = (*VARIABLES, "NUMBA_NUM_THREADS")

Report = Callable[[Chunk, float], None]
"""Called with a chunk and the simulated time (s) that its runs have reached."""


class WorkerError(RuntimeError):
    """A chunk cannot be computed; one line says which and why."""


def available_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0))


def throttled(send: Callable[[float], Any]) -> Callable[[float], None]:
    """Wrap a progress function so that it is called every `REPORT_EVERY` seconds at most."""
    last = 0.0

    def report(seconds: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= REPORT_EVERY:
            last = now
            send(seconds)

    return report


def serve(connection: Connection) -> None:
    """Compute the chunks that come through the pipe until the parent closes it: the work of a
    worker process."""
    maps: dict[str, RunMap] = {}
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            chunk, field_map = connection.recv()
            if field_map is not None:
                maps[chunk.map_key] = field_map
            answer: tuple[str, Any]
            try:
                report = throttled(lambda seconds: connection.send(("progress", seconds)))
                answer = ("done", compute(chunk, maps[chunk.map_key], report))
            except (BrokenPipeError, ConnectionResetError):
                raise
            except InputError as error:
                answer = ("refused", str(error))
            except Exception as error:
                answer = ("failed", f"{type(error).__name__}: {error}\n{traceback.format_exc()}")
            connection.send(answer)


@dataclass(slots=True, eq=False)
class _Worker:
    process: ForkServerProcess
    connection: Connection
    chunk: Chunk | None = None
    maps: set[str] = field(default_factory=set)

    @classmethod
    def start(cls) -> "_Worker":
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["__main__", __name__])
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs,), daemon=True, name="isogal-worker")
        with _one_thread(), _interrupts_blocked():
            process.start()
        theirs.close()
        return cls(process, ours)

    def give(self, chunk: Chunk, maps: Mapping[str, RunMap]) -> None:
        new = chunk.map_key not in self.maps
        self.chunk = chunk
        # a worker that has died is noticed by the end of its pipe
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.connection.send((chunk, maps[chunk.map_key] if new else None))
        self.maps.add(chunk.map_key)

    def stop(self) -> None:
        self.connection.close()
        self.process.terminate()
        self.process.join(5.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


def local_results(
    chunks: Sequence[Chunk], maps: Mapping[str, RunMap], workers: int, report: Report
) -> Generator[tuple[Chunk, Runs], None, None]:
    """Compute chunks by so many processes; yields them as they are finished.

    Parameters
    ----------
    chunks : sequence of Chunk
        Begun in this order.
    maps : mapping
        By `Chunk.map_key`.
    workers : int
        Processes; each uses one thread.
    report : callable
        Called with the progress of a chunk.

    Raises
    ------
    InputError
        The scenario of a chunk cannot be used.
    WorkerError
        A chunk failed, or its workers died `ATTEMPTS` times.
    """
    pool = _Pool(chunks, maps, workers)
    try:
        while pool.busy or pool.waiting:
            pool.start_waiting()
            for worker, chunk in pool.ready():
                try:
                    kind, value = worker.connection.recv()
                except (EOFError, ConnectionResetError):
                    pool.drop(worker, chunk)
                    report(chunk, 0.0)
                    continue
                if kind == "progress":
                    report(chunk, value)
                    continue
                worker.chunk = None
                _raise_failure(kind, value, chunk)
                yield chunk, value
    finally:
        for worker in pool.workers:
            worker.stop()


class _Pool:
    """Workers, and the chunks that wait for one."""

    def __init__(self, chunks: Sequence[Chunk], maps: Mapping[str, RunMap], workers: int) -> None:
        self.workers: list[_Worker] = []
        self.waiting = list(reversed(chunks))
        self._maps = maps
        self._most = workers
        self._attempts = dict.fromkeys(chunks, 0)

    @property
    def busy(self) -> list[_Worker]:
        """Workers that have a chunk."""
        return [worker for worker in self.workers if worker.chunk is not None]

    def start_waiting(self) -> None:
        """Give chunks to workers, new ones if need be, until all are busy."""
        idle = [worker for worker in self.workers if worker.chunk is None]
        count = len(self.workers) - len(idle)
        while self.waiting and count < self._most:
            if not idle:
                idle.append(_Worker.start())
                self.workers.append(idle[-1])
            chunk = self.waiting.pop()
            self._attempts[chunk] += 1
            idle.pop().give(chunk, self._maps)
            count += 1

    def ready(self) -> list[tuple[_Worker, Chunk]]:
        """Wait for workers that have something to say, or have died; return them and their
        chunks."""
        busy = self.busy
        ready = wait([worker.connection for worker in busy])
        return [(w, w.chunk) for w in busy if w.connection in ready and w.chunk is not None]

    def drop(self, worker: _Worker, chunk: Chunk) -> None:
        """Take out a worker that has died and put its chunk back; raises WorkerError where that
        was the last attempt."""
        self.workers.remove(worker)
        worker.process.join(5.0)
        code = worker.process.exitcode
        worker.stop()
        if self._attempts[chunk] >= ATTEMPTS:
            raise WorkerError(_death(chunk, code))
        self.waiting.append(chunk)


def _death(chunk: Chunk, code: int | None) -> str:
    how = f"ended with status {code}"
    if code is not None and code < 0:
        how = f"was killed by signal {-code} ({signal.Signals(-code).name})"
    hint = "; is there too little memory?" if code == -signal.SIGKILL else ""
    return f"{chunk.case}, {chunk.text()}: the worker {how}, {ATTEMPTS} times{hint}"


def _raise_failure(kind: str, value: Any, chunk: Chunk) -> None:
    if kind == "refused":
        raise InputError(value)
    if kind == "failed":
        message, _, trace = value.partition("\n")
        error = WorkerError(f"{chunk.case}, {chunk.text()}: {message}")
        error.add_note(trace)
        raise error


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes started here use one thread each: workers share the cores, and sums within a
    product of matrices keep one order."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


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
