"""From cases to results: what is on disk is taken from there, and the rest, of all cases, goes
through one queue to the workers."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass

from isogal.errors import InputError
from isogal.montecarlo.chunks import Answer, Case, Chunk, divide, fair_share, map_digest, runs_of
from isogal.montecarlo.progress import LiveProgress
from isogal.montecarlo.store import Store
from isogal.montecarlo.workers import Report, local_results
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

    def map_chunks(
        self, chunks: Sequence[Chunk], report: Report
    ) -> Generator[tuple[Chunk, Answer], None, None]:
        """Yield chunks and what has become of them, as they are finished; see `local_results` and
        `cluster_results`."""
        maps = {map_digest(chunk.case.field_map): chunk.case.field_map for chunk in chunks}
        if self.scheduler is None:
            return local_results(chunks, maps, min(self.count, len(chunks)), report)
        from isogal.montecarlo.cluster import cluster_results

        return cluster_results(chunks, maps, self.scheduler, report)


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
        See `Backend.map_chunks` and `runs_of`; what was finished is kept.
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
    if not chunks:
        return
    try:
        with closing(backend.map_chunks(chunks, display.reached)) as answers:
            for chunk, answer in answers:
                store.put(chunk, runs_of(answer, chunk))
                kept += len(chunk.runs)
                display.finished(chunk)
    except KeyboardInterrupt:
        raise Interrupted(kept, total) from None
