"""Finished runs on disk: one folder for each case, named by its key, and in it one file for each
chunk, named by its runs. A study that was interrupted goes on with them."""

import re
from dataclasses import replace
from pathlib import Path

from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.evaluation.results import write_json
from isogal.montecarlo.chunks import Case, Chunk

_NAME = re.compile(r"(\d{6,})-(\d{6,})\.npz")


class Store:
    """A folder of finished chunks. Files appear whole or not at all; several processes may write
    into one folder."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.damaged: list[str] = []
        """Files that were found damaged and removed, a line each."""

    def put(self, chunk: Chunk, runs: Runs) -> None:
        """Keep the runs of a chunk; of the details only those of run 0, which the figures show."""
        case = chunk.case
        place = self.folder / case.key
        note = place / "case.json"
        if not note.exists():
            scenario = case.scenario.model_dump(mode="json")
            write_json(note, {"case": case.name, "aided": case.aided, "scenario": scenario})
        if chunk.runs[0] != 0:
            runs = replace(runs, detail=None)
        runs.save(place / f"{chunk.runs[0]:06d}-{chunk.runs[-1]:06d}.npz")

    def missing(self, case: Case) -> list[int]:
        """Return which runs of a case are not there yet; a damaged file is removed."""
        there: set[int] = set()
        for path, first, last in chunk_files(self.folder / case.key):
            try:
                _read(path, last - first + 1)
            except InputError as error:
                self.damaged.append(str(error))
                path.unlink(missing_ok=True)
            else:
                there.update(range(first, last + 1))
        return [run for run in range(case.runs) if run not in there]

    def load(self, case: Case) -> Runs:
        """Return all runs of a case in order, from whatever chunks; raises InputError where one is
        missing or damaged."""
        parts: list[Runs] = []
        next_run = 0
        for path, first, last in chunk_files(self.folder / case.key):
            if next_run >= case.runs or last < next_run:
                continue
            if first > next_run:
                break
            parts.append(
                _read(path, last - first + 1).part(
                    range(next_run - first, min(last + 1, case.runs) - first)
                )
            )
            next_run = last + 1
        if next_run < case.runs:
            raise InputError(
                f"{self.folder / case.key}: run {next_run} of {case.runs} is not there"
            )
        return Runs.concatenate(parts)


def chunk_files(place: Path) -> list[tuple[Path, int, int]]:
    """Return the files in the folder of a case, in order, each with its first and last run."""
    found = [
        (path, int(match[1]), int(match[2]))
        for path in place.glob("*.npz")
        if (match := _NAME.fullmatch(path.name))
    ]
    return sorted(found, key=lambda item: item[1:])


def _read(path: Path, count: int) -> Runs:
    runs = Runs.load(path)
    if len(runs) != count:
        raise InputError(f"{path}: holds {len(runs)} runs, its name says {count}")
    return runs
