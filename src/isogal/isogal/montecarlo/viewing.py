"""A run of a finished study, as `isogal view` shows it."""

from pathlib import Path
from typing import TYPE_CHECKING

from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.evaluation.results import read_object
from isogal.evaluation.run_report import subtitle_of
from isogal.evaluation.view.record import ViewedRun
from isogal.fields.scenario_map import map_for_scenario
from isogal.files import Json
from isogal.montecarlo.store import file_of
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

if TYPE_CHECKING:
    from isogal.maps.channels import RouteMap


def open_study(folder: Path, run: int) -> "tuple[ViewedRun, RouteMap]":
    """Return a run of a study and the map that it was matched against.

    Raises
    ------
    InputError
        The folder holds no finished study, or the study no such run.
    """
    path = folder / "results.json"
    results = read_object(path)
    total, document = results.get("runs"), results.get("scenario")
    if not isinstance(total, int) or not isinstance(document, dict):
        raise InputError(f"{path}: not the results of a study")
    if run >= total:
        raise InputError(f"--run: {run}: {folder} has runs 0 to {total - 1}")
    scenario = validate_scenario(document, str(path))
    runs = Runs.load(file_of(_case_folder(folder, document), run))
    trajectory = build_trajectory(scenario)
    viewed = ViewedRun(
        runs,
        scenario,
        f"{folder.resolve().name}: run {run} of {total}",
        subtitle_of(runs, scenario),
    )
    return viewed, map_for_scenario(scenario, trajectory)


def _case_folder(folder: Path, scenario: Json) -> Path:
    for note in sorted((folder / "runs").glob("*/case.json")):
        case = read_object(note)
        if case.get("scenario") == scenario and case.get("aided", True):
            return note.parent
    raise InputError(f"{folder / 'runs'}: holds no runs of the scenario of results.json")
