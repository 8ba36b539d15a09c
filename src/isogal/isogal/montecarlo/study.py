"""From cases to results: what is on disk is taken from there, and the rest, of all cases, goes
through one queue to the workers."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from isogal.errors import InputError
from isogal.montecarlo.chunks import Case, Chunk, divide, fair_share, map_digest
from isogal.montecarlo.store import Store
from isogal.montecarlo.workers import available_cores, local_results


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


class Display(Protocol):
    """What shows the progress; see `isogal.montecarlo.progress`."""

    def begin(self, todo: Sequence[Chunk], kept: int) -> None:
        """Take note of the chunks to compute, and of how many runs were there already."""

    def reached(self, chunk: Chunk, seconds: float) -> None:
        """Take note that a chunk's runs have reached this simulated time (s)."""

    def finished(self, chunk: Chunk) -> None:
        """Take note that a chunk is computed and kept."""

    def say(self, text: str) -> None:
        """Show a line."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; what was finished is kept."""

    def __init__(self, kept: int, total: int) -> None:
        super().__init__(f"{kept} of {total} runs are kept")
        self.kept, self.total = kept, total


def compute_cases(cases: Sequence[Case], store: Store, backend: Backend, display: Display) -> None:
    """Compute what the store does not hold yet of some cases, and keep it there.

    Parameters
    ----------
    cases : sequence of Case
        Begun in this order. With the most expensive first, all workers are busy to the end.
    store : Store
        `Store.load` reads the results.
    backend : Backend
    display : Display

    Raises
    ------
    InputError, WorkerError
        See `local_results` and `cluster_results`; what was finished is kept.
    Interrupted
        Ctrl-C.
    """
    distinct: dict[str, Case] = {}
    for case in cases:
        known = distinct.setdefault(case.key, case)
        if case.runs > known.runs:
            distinct[case.key] = case
    missing = {key: store.missing(case) for key, case in distinct.items()}
    total, left = (
        sum(case.runs for case in distinct.values()),
        sum(len(runs) for runs in missing.values()),
    )
    share, kept = fair_share(left, backend.count), total - left
    chunks = [
        chunk for key, case in distinct.items() for chunk in divide(case, missing[key], share)
    ]
    for damage in store.damaged:
        display.say(f"computed again: {damage}")
    display.begin(chunks, kept)
    if not chunks:
        return
    maps = {map_digest(case.field_map): case.field_map for case in distinct.values()}
    try:
        if backend.scheduler is None:
            results = local_results(chunks, maps, min(backend.count, len(chunks)), display.reached)
        else:
            from isogal.montecarlo.cluster import cluster_results

            results = cluster_results(chunks, maps, backend.scheduler, display.reached)
        with closing(results):
            for chunk, runs in results:
                store.put(chunk, runs)
                kept += len(chunk.runs)
                display.finished(chunk)
    except KeyboardInterrupt:
        raise Interrupted(kept, total) from None
