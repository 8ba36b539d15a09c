"""Stage 4 of `pmht`: what the batch says about the map error.

docs/mathematics.md, sections 9.1 and 9.2.
"""

from dataclasses import replace

from isogal.matching.pmht.map_error import differs
from isogal.matching.pmht.prepare import without_bias
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
    learnt = state.map_error.update(
        state.batch, state.best.likelihood, state.field_map, state.best.mixture.mean[0]
    )
    told = state.settings.noise
    before, model = state.map_error.model(told), learnt.model(told)
    state = replace(state, learnt=learnt)
    if not differs(before, model):
        return state
    noise = model if state.bias is None else without_bias(model, state.field_map)
    again = rematch(state, noise=noise)
    return state if again.posterior is None else again
