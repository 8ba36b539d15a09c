"""Matchers by name, each building what its name says; unknown names and bad options give one
line."""

import pytest

from isogal.errors import InputError
from isogal.matching.registry import MATCHERS, build_matcher
from isogal.scenario import MATCHER_NAMES, Matcher


@pytest.mark.parametrize("name", MATCHERS)
def test_every_matcher_builds_and_knows_its_name(name):
    it = build_matcher(Matcher(name=name))
    assert it.name == name
    assert it.context >= 0
    assert callable(it.match)


def test_the_contracts_names_are_registered():
    assert set(MATCHERS) <= set(MATCHER_NAMES)
    assert {"pmht", "pmht-paper"} <= set(MATCHERS)


@pytest.mark.parametrize("name", MATCHERS)
def test_unknown_options_are_refused(name):
    with pytest.raises(
        InputError, match=f"matcher.options of {name}: unknown key 'nonsense'"
    ) as caught:
        build_matcher(Matcher(name=name, options={"nonsense": 1}))
    assert "\n" not in str(caught.value)


def test_bad_values_of_options_are_refused():
    with pytest.raises(
        InputError,
        match=r"matcher\.options of pmht: confidence: input should be less than 1, not 2",
    ):
        build_matcher(Matcher(options={"confidence": 2.0}))


@pytest.mark.parametrize(("name", "message"), [
    ("pmth", r"matcher\.name: unknown matcher 'pmth', did you mean 'pmht'\?"),
    ("zzz", r"matcher\.name: unknown matcher 'zzz'; allowed: .*pmht"),
])  # fmt: skip
def test_unknown_names(name, message):
    with pytest.raises(InputError, match=message):
        build_matcher(Matcher().model_copy(update={"name": name}))


def test_pmht_sees_a_batch_of_context_unless_told():
    assert build_matcher(Matcher(batch_length=20)).context == 20
    assert build_matcher(Matcher(batch_length=20, options={"context": 0})).context == 0
    assert build_matcher(Matcher(name="pmht-paper")).context == 0
