"""A matcher that raises, or is wrong, costs a batch, not the study."""

import numpy as np

from helpers.batches import field_map_of, wavy
from helpers.navigators import ROUTE
from isogal.evaluation.summary import summarise
from isogal.matching.interfaces import Fix, declined
from isogal.montecarlo.engine import simulate
from isogal.scenario import Gravimeter, Gravity, Matcher, Scenario

SCENARIO = Scenario(
    route=ROUTE.model_copy(update={"duration": 600.0}),
    gravimeter=Gravimeter(quantity="disturbance"),
    gravity=Gravity(field="normal"),  # the map is made up
    matcher=Matcher(batch_length=15, stride=15, map_sigma=1e-5),
)
MAP = field_map_of(wavy)


class Failing:
    """A matcher that fails once, in the second batch of the second run, and otherwise counts its
    calls: it raises, or is 78 km off."""

    name, context = "failing", 0

    def __init__(self, how):
        self.how, self.memories = how, []

    def match(self, batch, field_map, memory):
        self.memories.append(memory)
        if len(self.memories) != 6 or self.how == "never":
            return declined(batch, "nothing"), (memory or 0) + 1
        if self.how == "raises":
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return Fix(batch.time[-1], batch.latitude[-1] + 0.0122, batch.longitude[-1], np.eye(2)), 0


def outcomes_of(runs):
    return summarise(runs, SCENARIO, np.full(runs.time.shape, np.nan))["fixes"]


def test_a_matcher_that_raises_costs_one_batch_of_one_run():
    matcher = Failing("raises")
    runs = simulate(SCENARIO, [0, 1], MAP, matcher)
    assert matcher.memories == [None, 1, 2, 3, None, 1, 1, 2]  # as before the batch
    reason = str(runs.fix_reason[1, 1])
    assert reason.startswith("the matcher failed: LinAlgError: Matrix is not positive definite (")
    fixes = {"published": 0, "declined": 8, "failed": 1, "rejected": 0}
    assert outcomes_of(runs) == fixes


def test_a_false_fix_is_rejected_counted_and_moves_nothing():
    runs, without = (simulate(SCENARIO, [0, 1], MAP, Failing(how)) for how in ("wrong", "never"))
    np.testing.assert_array_equal(runs.error, without.error)
    np.testing.assert_array_equal(runs.covariance, without.covariance)
    reason = str(runs.fix_reason[1, 1])
    assert reason.startswith("rejected by the navigator: 77.")
    assert "normalised innovation squared" in reason
    fixes = {"published": 0, "declined": 8, "failed": 0, "rejected": 1}
    assert outcomes_of(runs) == fixes
