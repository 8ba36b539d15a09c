"""Small studies of many runs, shared by the tests of Monte Carlo."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.evaluation.records import Runs
from isogal.maps.field_map import FieldMap
from isogal.montecarlo.cases import Job
from isogal.scenario import Scenario, validate_scenario


def wavy_map(quantity: str = "disturbance") -> FieldMap:
    """Waves of 30 mGal and a few kilometres, everywhere about the start of the default route."""
    latitude, longitude = (
        np.radians(np.linspace(-38.2, -37.5, 141)),
        np.radians(np.linspace(144.2, 145.2, 201)),
    )
    north, east = (
        (latitude[:, None] - latitude[0]) * 6.4e6,
        (longitude[None, :] - longitude[0]) * 5.0e6,
    )
    values = 3e-4 * np.sin(north / 2500.0) * np.cos(east / 3100.0 + north / 9000.0)
    return FieldMap(latitude, longitude, values, "m/s²", quantity, provenance="waves")


def small_scenario(**changes: object) -> Scenario:
    """Ten minutes with three batches of the paper's matcher. Nothing is felt of the made-up map,
    which would cost its Fourier transform in each worker."""
    document = {
        "route": {"duration": 600.0},
        "gravimeter": {"quantity": "disturbance"},
        "gravity": {"field": "normal"},
        "matcher": {"name": "pmht-paper", "batch_length": 20},
    }
    return validate_scenario(document | changes)


def outcomes(reasons: ArrayLike) -> dict[str, np.ndarray]:
    """Status and reason of batches (R, B), as a record has them, from why each was declined; empty
    where it was not."""
    texts = np.array(reasons, dtype=np.str_)
    return {"fix_status": np.where(texts == "", "fix", "declined"), "fix_reason": texts}


def same_runs(a: Runs, b: Runs) -> None:
    """Assert that two records hold the same numbers, bit for bit, and the same details if both
    have some."""
    for name in (
        *("error", "covariance", "unaided_error", "fix_error", "fix_covariance"),
        *("posterior_error", "posterior_covariance", "fix_status", "fix_reason"),
    ):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    if a.detail is not None and b.detail is not None:
        np.testing.assert_array_equal(a.detail.reading, b.detail.reading)
        np.testing.assert_array_equal(a.detail.candidate_weight, b.detail.candidate_weight)


class Watcher:
    """A display that remembers."""

    def __init__(self) -> None:
        self.todo: list[Job] = []
        self.kept = 0
        self.done: list[Job] = []
        self.said: list[str] = []

    def begin(self, todo: Sequence[Job], kept: int) -> None:
        self.todo, self.kept = list(todo), kept

    def computed(self, job: Job) -> None:
        self.done.append(job)

    def say(self, text: str) -> None:
        self.said.append(text)
