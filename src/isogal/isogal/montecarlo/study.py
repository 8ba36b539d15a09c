"""From cases to results: what is on disk is taken from there, and the rest, of all cases, goes
through one queue to the workers."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass

from isogal.errors import InputError
from isogal.montecarlo.cases import Case, Job
from isogal.montecarlo.progress import LiveProgress
from isogal.montecarlo.store import Store
from isogal.montecarlo.workers import Submit, cluster, computed, processes
from isogal.threads import available_cores


@dataclass(frozen=True, slots=True)
class Backend:
    """Where runs are computed."""

    workers: int | None = None
    """Processes on this machine; None = one for each core."""
    scheduler: str | None = None
    """Address of a Dask scheduler instead."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.scheduler is not None:
            raise InputError("--workers and --scheduler: give one of them")

    def start(self, jobs: Sequence[Job]) -> AbstractContextManager[Submit]:
        """Start workers for jobs; see `processes` and `cluster`."""
        cases = {job.case.key: job.case for job in jobs}
        if self.scheduler is None:
            return processes(cases, min(self.workers or available_cores(), len(jobs)))
        return cluster(cases, self.scheduler)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; what was finished is kept."""

    def __init__(self, kept: int, total: int) -> None:
        self.kept, self.total = kept, total


def compute_cases(
    cases: Sequence[Case], store: Store, backend: Backend, display: LiveProgress
) -> None:
    """Compute what the store does not hold yet of some cases, and keep it there.

    Parameters
    ----------
    cases : sequence of Case
        Begun in this order. With the most expensive first, all workers are busy to the end.
    store : Store
        `Store.load` reads the results.
    backend : Backend
    display : LiveProgress

    Raises
    ------
    InputError, WorkerError
        See `computed`; what was finished is kept.
    Interrupted
        Ctrl-C.
    """
    total = sum(case.runs for case in cases)
    jobs = [Job(case, run) for case in cases for run in store.missing(case)]
    kept = total - len(jobs)
    display.begin(jobs, kept)
    try:
        with closing(computed(jobs, backend.start)) as finished:
            for job, runs in finished:
                store.put(job, runs)
                kept += 1
                display.computed(job)
    except KeyboardInterrupt:
        raise Interrupted(kept, total) from None
