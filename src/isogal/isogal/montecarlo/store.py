"""Finished runs on disk: one folder for each case, named by its key, and in it one file for each
run. A study that was interrupted goes on with them."""

from dataclasses import replace
from pathlib import Path

from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.evaluation.results import write_json
from isogal.montecarlo.cases import Case, Job


class Store:
    """A folder of finished runs. Files appear whole or not at all; several processes may write
    into one folder."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def put(self, job: Job, runs: Runs) -> None:
        """Keep a run; its details only where it is run 0, which the figures show."""
        case = job.case
        place = self.folder / case.key
        note = place / "case.json"
        if not note.exists():
            scenario = case.scenario.model_dump(mode="json")
            write_json(note, {"case": case.name, "aided": case.aided, "scenario": scenario})
        kept = runs if job.run == 0 else replace(runs, detail=None)
        kept.save(file_of(place, job.run))

    def missing(self, case: Case) -> list[int]:
        """Return which runs of a case are not there yet, or damaged."""
        found = []
        for run in range(case.runs):
            try:
                Runs.load(file_of(self.folder / case.key, run))
            except InputError:
                found.append(run)
        return found

    def load(self, case: Case) -> Runs:
        """Return all runs of a case in order; raises InputError where one is missing or
        damaged."""
        place = self.folder / case.key
        return Runs.concatenate([Runs.load(file_of(place, run)) for run in range(case.runs)])


def file_of(place: Path, run: int) -> Path:
    """Return the file of a run in the folder of a case."""
    return place / f"{run:06d}.npz"
