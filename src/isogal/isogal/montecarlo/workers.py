"""Who computes runs: processes of this machine, or the workers of a Dask cluster, both by the
interface of `concurrent.futures`.

A script that computes by processes needs the guard ``if __name__ == "__main__"``, since each of
them imports it."""

import multiprocessing
import os
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import TYPE_CHECKING

from isogal import forkserver
from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.montecarlo.cases import Case, Job, source_digest
from isogal.threads import VARIABLES

if TYPE_CHECKING:
    from distributed import Client

ATTEMPTS = 3
"""How often in a row worker processes may die before any run is finished."""
TIMEOUT = 10.0
"""s to wait for a scheduler."""
_THREADS = (*VARIABLES, "NUMBA_NUM_THREADS")

Submit = Callable[[Job], Future[Runs | Path]]
"""Has a run computed, and returns it or the file that it is in."""


class WorkerError(RuntimeError):
    """Runs cannot be computed; one line says why."""


def computed(
    jobs: Sequence[Job], start: Callable[[Sequence[Job]], AbstractContextManager[Submit]]
) -> Generator[tuple[Job, Runs], None, None]:
    """Yield jobs with their runs as they are finished. Where a worker process dies, new ones
    take its place and what is left.

    Parameters
    ----------
    jobs : sequence of Job
        Begun in this order.
    start : callable
        Returns workers for jobs: `processes` or `cluster` of their cases.

    Raises
    ------
    InputError
        The scenario of a job cannot be used; see also `cluster`.
    WorkerError
        Anything else has gone wrong with a job, or workers died `ATTEMPTS` times in a row.
    """
    left, deaths = list(jobs), 0
    while left:
        try:
            with start(left) as submit:
                futures = {submit(job): job for job in left}
                for future in as_completed(futures):
                    job = futures.pop(future)  # which drops its result, too
                    runs = _result(future, job)
                    left.remove(job)
                    deaths = 0
                    yield job, runs
        except BrokenProcessPool:
            deaths += 1
            if deaths == ATTEMPTS:
                raise WorkerError(
                    f"{left[0]} and after it: workers were killed {deaths} times in a row before"
                    " a run was finished; is there too little memory?"
                ) from None


def _result(future: Future[Runs | Path], job: Job) -> Runs:
    try:
        found = future.result()
    except (InputError, BrokenProcessPool):
        raise
    except Exception as error:
        raise WorkerError(f"{job}: {type(error).__name__}: {error}") from error
    if isinstance(found, Runs):
        return found
    runs = Runs.load(found)
    found.unlink()
    return runs


@contextmanager
def processes(cases: Mapping[str, Case], count: int) -> Iterator[Submit]:
    """Start so many processes of this machine (`isogal.forkserver`); at the end they are killed.

    Parameters
    ----------
    cases : mapping
        By their keys; each process is sent them once.
    count : int
        Each uses one thread.
    """
    forkserver.preload(__name__)
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, forkserver.CONTEXT, _take, (cases,))
    with TemporaryDirectory(prefix="isogal-") as folder:

        def submit(job: Job) -> Future[Runs | Path]:
            with _as_worker():
                return pool.submit(_compute, job.case.key, job.run, Path(folder))

        try:
            yield submit
        finally:
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
            pool.shutdown(cancel_futures=True)


_cases: dict[str, Case] = {}
"""Of a worker process."""


def _take(cases: Mapping[str, Case]) -> None:
    _cases.update(cases)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker once the program that it works for is gone, killed for example: it would
    wait for ever for the next run, as it holds both ends of the pool's pipe."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _compute(key: str, run: int, folder: Path) -> Path:
    """Compute a run of a case; return the file that it is in. A worker that is killed while it
    sends more than fits into the pool's pipe would leave the parent waiting for the rest."""
    path = folder / f"{key}-{run}.npz"
    _cases[key].compute(run).save(path)
    return path


@contextmanager
def _as_worker() -> Iterator[None]:
    """Let processes started here use one thread each, since workers share the cores and sums
    within a product of matrices are to keep one order; and block Ctrl-C in them."""
    environment = dict(os.environ)
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        with forkserver.interrupts_blocked():
            yield
    finally:
        os.environ.clear()
        os.environ.update(environment)


@contextmanager
def cluster(cases: Mapping[str, Case], address: str) -> Iterator[Submit]:
    """Use the workers of a Dask cluster. If one dies, Dask gives its run to another,
    `distributed.scheduler.allowed-failures` times.

    Parameters
    ----------
    cases : mapping
        By their keys; each worker is sent them once.
    address : str
        Of the scheduler, for example ``tcp://host:8786``.

    Raises
    ------
    InputError
        No scheduler answers there, or its workers run other source code.
    """
    client = _connected(address)
    try:
        check_code(client, address, source_digest())
        (sent,) = client.scatter([cases], broadcast=True, hash=False)
        pool = client.get_executor(pure=False)
        try:
            yield lambda job: pool.submit(_of_cluster, sent, job.case.key, job.run)
        finally:
            pool.shutdown(wait=False)
    finally:
        client.close()


def _of_cluster(cases: Mapping[str, Case], key: str, run: int) -> Runs:
    return cases[key].compute(run)


def _connected(address: str) -> "Client":
    from distributed import Client
    from distributed.comm.addressing import parse_address, parse_host_port

    try:
        scheme, place = parse_address(address)
        if scheme in ("tcp", "tls"):
            parse_host_port(place)  # else a client is half made, and its end takes 20 s
        return Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error})"
        ) from None


def check_code(client: "Client", address: str, mine: str) -> None:
    """Raise InputError unless all workers run the source code with this digest."""
    try:
        digests = client.run(source_digest)
    except Exception as error:
        raise InputError(
            f"--scheduler {address}: its workers cannot import isogal ({type(error).__name__}:"
            f" {error})"
        ) from None
    if not digests:
        raise InputError(f"--scheduler {address}: has no workers")
    other = sorted(worker for worker, digest in digests.items() if digest != mine)
    if other:
        raise InputError(
            f"--scheduler {address}: {len(other)} of {len(digests)} workers run another Isogal"
            f" than this one, for example {other[0]}"
        )
