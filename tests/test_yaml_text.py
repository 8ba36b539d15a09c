"""YAML that cannot be used is refused in one line, whatever PyYAML raises of it."""

import pytest

from isogal.errors import InputError
from isogal.scenario import load_scenario
from isogal.yaml_text import parse_yaml

BOMB = "a0: &a0 [x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12)
)
MERGED = "a0: &a0 {x: 1}\n" + "".join(
    f"a{k}: &a{k}\n  <<: [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12)
)


def test_what_is_said_is_read() -> None:
    text = "a: &a [1, 2.5]\nb: *a\nc: {<<: {d: x}, e: null}\n"
    assert parse_yaml(text, "x") == {"a": [1, 2.5], "b": [1, 2.5], "c": {"d": "x", "e": None}}
    assert parse_yaml("", "x") is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: [1\nb: 2", r"not valid YAML \(line 2\): "),
        ("a: \x00", "special characters"),
        ("a: 2020-99-99", "month must be in"),
        ("a: 1\nb: {c: 1, c: 2}", r"\(line 2\): key 'c' is there twice"),
        ("a: !!int ''", "not valid YAML: "),
        ("a: !!bool x", "not valid YAML: "),
        ("a: " + 5000 * "9", "limit"),
        (1_000 * "[", "nested too deeply"),
        ("a: &a [*a]", r"\(line 1\): refers to itself"),
        ("a: &a {<<: *a}", "refers to itself"),
        ("!!python/object/apply:os.system ['true']", "could not determine a constructor"),
        (BOMB, "stands for more than 10000000 characters"),
        (MERGED, "stands for more than 10000000 characters"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(text, says, tmp_path) -> None:
    with pytest.raises(InputError, match=says) as caught:
        parse_yaml(text, "here")
    assert str(caught.value).startswith("here: not valid YAML")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(InputError, match=r"s\.yaml: not valid YAML"):
        load_scenario(tmp_path / "s.yaml")
