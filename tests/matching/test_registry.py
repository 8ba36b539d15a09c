"""Matchers by name: each is built, and whatever is wrong with its settings gives one line."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import make_batch
from isogal import plugins
from isogal.errors import InputError
from isogal.matching.registry import load_matcher
from isogal.scenario import Matcher

MATCHERS = plugins.names(plugins.MATCHERS)


@pytest.mark.parametrize("name", MATCHERS)
def test_every_matcher_builds_and_knows_its_name(name):
    it = load_matcher(Matcher(name=name))
    assert it.name == name
    assert it.context >= 0
    assert callable(it.match)


@pytest.mark.parametrize(("changes", "reason"), [
    ({"latitude": np.full(30, np.nan)}, "latitude of the navigator is not finite"),
    ({"covariance": np.full((7, 7), np.nan)}, "covariance of the navigator is not finite"),
    ({"covariance": -np.eye(7)}, "the navigator's covariance is not positive definite"),
    ({"time": np.zeros(30)}, "the stamps of the scans do not increase"),
    ({"sigma": np.zeros(30)}, "sigma of a reading is not positive"),
])  # fmt: skip
@pytest.mark.parametrize("name", MATCHERS)
def test_what_no_matcher_can_use_is_declined(name, changes, reason, rough_map):
    batch = replace(make_batch(rough_map)[0], **changes)
    fix, memory = load_matcher(Matcher(name=name)).match(batch, rough_map, None)
    assert fix.reason == reason
    assert memory is None


@pytest.mark.parametrize("name", MATCHERS)
def test_unknown_options_are_refused(name):
    with pytest.raises(
        InputError, match=rf"^matcher\.options of {name}: unknown key 'nonsense'(; allowed: \w+)?"
    ) as caught:
        load_matcher(Matcher(name=name, options={"nonsense": 1}))
    assert "\n" not in str(caught.value)


def test_bad_values_of_options_are_refused():
    with pytest.raises(
        InputError,
        match=r"matcher\.options of pmht: trust: must be .* 1, not 0\.5",
    ):
        load_matcher(Matcher(options={"trust": 0.5}))


@pytest.mark.parametrize(("name", "message"), [
    ("pmth", r"unknown matcher 'pmth' \(did you mean 'pmht'\?\)"),
    ("zzz", r"unknown matcher 'zzz'; allowed: .*pmht"),
])  # fmt: skip
def test_unknown_names(name, message):
    with pytest.raises(InputError, match=message):
        load_matcher(Matcher().model_copy(update={"name": name}))


def test_an_unknown_option_gets_the_nearest_of_its_matcher():
    with pytest.raises(InputError, match=r"unknown key 'trus', did you mean 'trust'\?"):
        load_matcher(Matcher(options={"trus": 2.0}))


def test_only_pmht_takes_several_channels():
    assert load_matcher(Matcher(), channels=True).takes_channels
    for name in set(MATCHERS) - {"pmht"}:
        with pytest.raises(
            InputError,
            match=rf"^matcher\.name: {name} takes one number .* several channels give pmht$",
        ):
            load_matcher(Matcher(name=name), channels=True)
