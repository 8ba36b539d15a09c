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


class Raising:
    """A matcher that raises on one of its calls, and otherwise counts them."""

    name, context = "raising", 0

    def __init__(self, call):
        self.call, self.memories = call, []

    def match(self, batch, field_map, memory):
        self.memories.append(memory)
        if len(self.memories) == self.call:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return declined(batch, "nothing"), (memory or 0) + 1


def test_a_matcher_that_raises_costs_one_batch_of_one_run():
    matcher = Raising(6)  # the second batch of the second run
    runs = simulate(SCENARIO, [0, 1], field_map_of(wavy), matcher)
    assert matcher.memories == [None, 1, 2, 3, None, 1, 1, 2]  # as before the batch
    assert runs.fix_reason[0] == ("nothing",) * 4
    first, failed, *others = runs.fix_reason[1]
    assert [first, *others] == ["nothing"] * 3
    assert failed.startswith("the matcher failed: LinAlgError: Matrix is not positive definite (")
    fixes = summarise(runs, SCENARIO, np.full(runs.time.shape, np.nan))["fixes"]
    assert fixes == {"published": 0, "declined": 8, "failed": 1, "rejected": 0}


class Wrong:
    """A matcher whose fix of one batch of the second run is 78 km off."""

    name, context = "false", 0

    def __init__(self):
        self.calls = 0

    def match(self, batch, field_map, memory):
        self.calls += 1
        if self.calls != 6:
            return declined(batch, "nothing"), None
        return Fix(batch.time[-1], batch.latitude[-1] + 0.0122, batch.longitude[-1], np.eye(2)), 0


def test_a_false_fix_is_rejected_counted_and_moves_nothing():
    field_map = field_map_of(wavy)
    runs, without = (simulate(SCENARIO, [0, 1], field_map, it) for it in (Wrong(), Raising(99)))
    np.testing.assert_array_equal(runs.error, without.error)
    np.testing.assert_array_equal(runs.covariance, without.covariance)
    reason = runs.fix_reason[1][1]
    assert reason.startswith("rejected by the navigator: 77.")
    assert "normalised innovation squared" in reason
    none = np.full(runs.time.shape, np.nan)
    fixes = summarise(runs, SCENARIO, none)["fixes"]
    assert fixes == {"published": 0, "declined": 8, "failed": 0, "rejected": 1}
