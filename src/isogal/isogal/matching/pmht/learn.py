"""Stage 4 of `pmht`: what the batch says about the map error.

docs/mathematics.md, sections 9.1 and 9.2.
"""

from dataclasses import replace

import numpy as np

from isogal.matching.pmht.error_chain import NewReadings, is_chain
from isogal.matching.pmht.map_error import MapErrorEstimate, differs
from isogal.matching.pmht.prepare import unknown_bias, without_bias
from isogal.matching.pmht.state import State, rematch


def learn(state: State) -> State:
    """Return the state after a batch that agrees with the map has taught its error.

    One that does not agree teaches nothing here: a wrong place must not pass for a wrong map.
    """
    return learn_from(state) if state.agrees else state


def learn_from(state: State) -> State:
    """Return the state with the map error learnt, matched again where that makes a difference."""
    if state.map_error is None:
        return state
    learnt = _learnt(state, state.map_error)
    told = state.settings.noise
    before, model = state.map_error.model(told), learnt.model(told)
    state = replace(state, learnt=learnt)
    if not differs(before, model):
        return state
    noise = model if state.bias is None else without_bias(model, state.field_map)
    again = rematch(state, noise=noise)
    return state if again.posterior is None else again


def _learnt(state: State, before: MapErrorEstimate) -> MapErrorEstimate:
    """Return what a batch makes of an estimate."""
    likelihood, mean = state.best.likelihood, state.best.mixture.mean[0]
    if not is_chain(state.as_read):
        return before.update(state.batch, likelihood, state.field_map, mean)
    rows = likelihood.rows[likelihood.first_new :]
    new = NewReadings.of(state.as_read, rows, state.first_map, mean)
    if state.bias is None:
        return before.follow(new, None)
    unknown = unknown_bias(state.as_read, state.field_map, state.settings)
    return before.follow(new, np.sqrt(np.diag(unknown.covariance)[:2]))
