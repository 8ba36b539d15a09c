"""The section `truth` of a scenario: what really is, apart from what is assumed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isogal.errors import InputError
from isogal.scenario import Assumed, Scenario, Truth, load_scenario, truth_of
from isogal.scenario.aids import PositionAid
from isogal.scenario.truth import SECTIONS, SHARED

LARGE = ["gravimeter.bias=2e-5", "initial_error.hidden_position=1000"]


def test_without_truth_all_is_as_assumed():
    it = load_scenario(None, ["seed=3"])
    assert it.truth == {}
    assert dict(it.true) == {name: getattr(it, name) for name in Truth.model_fields}
    assert it.true.informed == it
    # neither passes for the other
    assert isinstance(it, Assumed) and not isinstance(it, Truth)
    assert not isinstance(it.true, Assumed)
    with pytest.raises(TypeError, match=r"give `scenario\.true`"):
        it.informed  # noqa: B018 - which the bound asks for first


def test_the_true_keys_stand_in_the_truth_alone():
    it = load_scenario(
        None, ["truth.imu.grade=quantum", "truth.gravimeter={sigma: 4e-5, bias: 1e-5}"]
    )
    assert (it.imu.grade, it.gravimeter.sigma, it.gravimeter.bias) == ("precision", 1e-5, 0.0)
    true = it.true
    assert (true.imu.grade, true.gravimeter.sigma, true.gravimeter.bias) == ("quantum", 4e-5, 1e-5)
    others = {"imu", "gravimeter", "truth"}
    assert true.model_dump(exclude=others) == it.model_dump(exclude=others)
    assert true.truth == {} and true.informed.true == true


@given(st.floats(0.01, 100.0))
def test_a_multiple_is_of_what_is_told(factor):
    it = load_scenario(None, ["gravimeter.sigma=2e-5", f"truth.gravimeter.sigma={factor!r}x"])
    assert it.true.gravimeter.sigma == pytest.approx(factor * 2e-5, rel=1e-12)
    assert it.gravimeter.sigma == 2e-5


def test_a_whole_section_may_be_a_multiple():
    it = load_scenario(None, [*LARGE, "truth.initial_error=3x", "truth.gravimeter=2x"])
    before, after = it.initial_error, it.true.initial_error
    for key in ("position", "velocity", "tilt", "heading"):
        assert getattr(after, key) == pytest.approx(3.0 * getattr(before, key))
    assert after.hidden_position == 1000.0  # which nobody is told of anyway
    assert it.true.gravimeter.sigma == pytest.approx(2e-5)
    assert it.true.gravimeter.bias == pytest.approx(4e-5)
    assert it.true.gravimeter.drift == 0.0
    assert it.true.gravimeter.outlier_sigma == it.gravimeter.outlier_sigma


@pytest.mark.parametrize(("override", "message"), [
    ("truth.gravimeter.bias=3x", "truth.gravimeter.bias: 3x of 0.0 says nothing"),
    ("truth.imu.grade=3x", "truth.imu.grade: 3x of 'precision' says nothing"),
    ("truth.gravimeter=5", "truth.gravimeter: must be keys of gravimeter with their true values"),
    ("truth.altimeter=3x", "truth.altimeter: 3x of the whole section says nothing; name its keys"),
    ("truth.imuu.grade=quantum", "unknown key 'truth.imuu', did you mean 'truth.imu'?"),
    ("truth.route.speed=5", "unknown key 'truth.route'; allowed: truth.imu, truth.initial_"),
    ("truth.gravimeter.sgma=3x", "unknown key 'truth.gravimeter.sgma', did you mean 'truth.gravi"),
    ("truth.gravimeter.sigma={a: 3x}", "truth.gravimeter.sigma: must be a number"),
    ("truth.gravimeter.sigma=-1", "truth.gravimeter.sigma: must be greater than 0, not"),
    ("truth.imu.rate=2", "truth.imu.rate: cannot differ from imu.rate (1.0), which says what the"),
    ("truth.gravimeter.interval=2x", "truth.gravimeter.interval: cannot differ from gravimeter."),
    ("truth.altimeter.min_range=3e4", "truth.altimeter: min_range (30000 m) must be below max_ra"),
])  # fmt: skip
def test_bad_truths_are_one_clear_line(override, message):
    with pytest.raises(InputError) as caught:
        load_scenario(None, [override])
    assert str(caught.value).startswith(f"scenario: {message}"), str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_section_and_shared_key_is_one_of_the_scenario():
    fields = Scenario.model_fields
    assert set(SECTIONS) <= set(fields)
    for name in SECTIONS:
        section = getattr(Scenario(), name)
        for key in section.errors:
            value = section.resolved()
            for part in key.split("."):
                value = value[part]
        assert Scenario(truth={name: {}}).true == Scenario().true
    sections = [type(getattr(Scenario(), name)).model_fields for name in SECTIONS]
    assert set(SHARED) <= set().union(*sections, PositionAid.model_fields)


def test_a_node_takes_what_it_knows_of():
    truth = {"imu": "3x", "gravimeter": {"sigma": 1e-4}, "imuu": {}}
    assert truth_of(truth, ("imu", "seed")) == {"imu": "3x", "imuu": {}}
