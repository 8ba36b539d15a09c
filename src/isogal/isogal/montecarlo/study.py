"""From cases to results: what is on disk is taken from there, and the rest, of all cases, goes
through one queue to the workers."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass

from isogal.errors import InputError
from isogal.montecarlo.chunks import Case, Chunk, divide, fair_share, map_digest
from isogal.montecarlo.progress import LiveProgress
from isogal.montecarlo.store import Store
from isogal.montecarlo.workers import Submit, cluster, computed, processes
from isogal.threads import available_cores


@dataclass(frozen=True, slots=True)
class Backend:
    """Where chunks are computed."""

    workers: int | None = None
    """Processes on this machine; None = one for each core."""
    scheduler: str | None = None
    """Address of a Dask scheduler instead."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.scheduler is not None:
            raise InputError("--workers and --scheduler: give one of them")
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers: must be at least 1, is {self.workers}")

    @property
    def count(self) -> int:
        """Number of workers that the work is divided for."""
        return self.workers or (8 if self.scheduler else available_cores())

    def start(self, chunks: Sequence[Chunk]) -> AbstractContextManager[Submit]:
        """Start workers for chunks; see `processes` and `cluster`."""
        maps = {map_digest(chunk.case.field_map): chunk.case.field_map for chunk in chunks}
        if self.scheduler is None:
            return processes(maps, min(self.count, len(chunks)))
        return cluster(maps, self.scheduler)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; what was finished is kept."""

    def __init__(self, kept: int, total: int) -> None:
        super().__init__(f"{kept} of {total} runs are kept")
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
    largest: dict[str, Case] = {}
    for case in cases:
        if case.key not in largest or case.runs > largest[case.key].runs:
            largest[case.key] = case
    missing = {key: store.missing(case) for key, case in largest.items()}
    total = sum(case.runs for case in largest.values())
    left = sum(map(len, missing.values()))
    share, kept = fair_share(left, backend.count), total - left
    chunks = [
        chunk for key, case in largest.items() for chunk in divide(case, missing[key], share)
    ]
    for damage in store.damaged:
        display.say(f"computed again: {damage}")
    display.begin(chunks, kept)
    try:
        with closing(computed(chunks, backend.start)) as finished:
            for chunk, runs in finished:
                store.put(chunk, runs)
                kept += len(chunk.runs)
                display.finished(chunk)
    except KeyboardInterrupt:
        raise Interrupted(kept, total) from None
