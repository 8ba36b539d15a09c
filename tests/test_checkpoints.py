"""Checkpoints: what goes in comes out, and nothing else is ever taken."""

import json
import math
import pickle
import subprocess
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isogal import checkpoints
from isogal.checkpoints import Saved, decode, encode, load, owner, save
from isogal.errors import InputError
from isogal.inertial.error_state import Estimate
from isogal.matching.interfaces import Information, SecondaryBatch
from isogal.matching.pmht.memory import Memory
from isogal.matching.pmht.search import Diverged

ME = owner({"seed": 1}, 0)

plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
values = st.recursive(
    plain,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.tuples(inner, inner)
        | st.dictionaries(st.text(), inner, max_size=4)
        | st.frozensets(st.floats(allow_nan=False), max_size=4)
    ),
    max_leaves=12,
)


def same(a: object, b: object) -> bool:
    """Whether two values are equal, of equal types, NaN equal to NaN."""
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    if isinstance(a, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return type(a) is type(b) and a == b


@given(values, st.integers(-(2**62), 2**62))
def test_there_and_back(value, time) -> None:
    got = decode(encode(ME, Saved(time, value)), ME, "here")
    assert got.time == time
    assert same(got.content, value)


@pytest.mark.parametrize("kind", ["<f8", "<f4", "<i8", "<u1", "|b1", ">f8"])
@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 0, 3), (2, 3)])
def test_arrays(kind, shape) -> None:
    array = np.arange(math.prod(shape)).reshape(shape).astype(kind)
    got = decode(encode(ME, Saved(0, array)), ME, "here").content
    assert got.dtype == array.dtype
    np.testing.assert_array_equal(got, array)


def test_dataclasses_and_named_tuples_of_the_library(tmp_path) -> None:
    memory = Memory({}, Diverged.before(3.0 * np.eye(7), 5.0), np.eye(7))
    estimate = Estimate(np.ones(3), np.zeros(3), np.array([1.0, 0, 0, 0]))
    path = tmp_path / "deep" / "file"
    save(
        path, ME, Saved(7, {"memory": memory, "estimate": estimate, "set": frozenset({1.0, 2.0})})
    )
    content = load(path, ME).content
    assert isinstance(content["memory"], Memory)
    assert content["set"] == {1.0, 2.0}
    np.testing.assert_array_equal(content["memory"].diverged.start, 3.0 * np.eye(7))
    np.testing.assert_array_equal(content["memory"].covariance, 3.0 * np.eye(7))
    assert isinstance(content["estimate"], Estimate)


def test_what_is_left_out_is_found_anew() -> None:
    beside = SecondaryBatch(1, Information(np.ones(4), np.eye(4)), None)
    data = encode(ME, Saved(0, beside), lambda value: isinstance(value, Information))
    got = decode(data, ME, "here", restore=lambda known: f"of field {known['field']}")
    assert got.content.batch == "of field 1"
    with pytest.raises(InputError) as failure:
        decode(data, ME, "here")
    assert "batch was left out" in str(failure.value.__cause__)


@dataclass
class Foreign:
    """Of no package that a reader names."""

    x: int = 1


class Trap:
    def __reduce__(self):
        return subprocess.check_output, (["false"],)


@pytest.mark.parametrize("value", [Foreign(), object(), np.array([object()]), {1, "a"}, Trap()])
def test_what_cannot_be_saved_or_must_not_be_made(value) -> None:
    with pytest.raises((TypeError, InputError)):
        decode(encode(ME, Saved(0, value)), ME, "here")


def forged(content: object, arrays: list | None = None) -> bytes:
    """A file whose checksum is right."""
    header = {"owner": ME, "time": 0, "content": content, "arrays": arrays or []}
    text = json.dumps(header).encode()
    body = len(text).to_bytes(8, "little") + text
    digest = checkpoints.hashlib.sha256(body).hexdigest()
    return f"isogal-checkpoint {checkpoints.VERSION} {digest}\n".encode() + body


@pytest.mark.parametrize(("data", "words"), [
    (b"", "not a checkpoint"),
    (pickle.dumps(Trap()), "not a checkpoint"),
    (b"isogal-checkpoint 1 abc\n", "version 1"),
    (f"isogal-checkpoint {checkpoints.VERSION} abc\n".encode(), "checksum"),
    (forged({"class": "subprocess:Popen", "fields": {"args": "true"}}), "class subprocess:Popen"),
    (forged({"class": "isogal.files:os.system", "fields": {}}), "class isogal.files:os.system"),
    (forged({"class": "isogal.files:write_atomic", "fields": {}}), "class isogal.files"),
    (forged({"class": "isogal.matching.pmht.memory:Memory", "fields": {}}), "missing 3 required"),
    (forged({"array": 0}), "IndexError"),
    (forged(1, [["<f8", [10**12]]]), "ValueError"),
    (forged(1, [["|O", [1]]]), "array of"),
    (forged({"python": 1}), "KeyError"),
])  # fmt: skip
def test_what_is_no_checkpoint_is_refused(data, words) -> None:
    with pytest.raises(InputError) as failure:
        decode(data, ME, "here")
    assert words in f"{failure.value} {failure.value.__cause__!r}"
    assert str(failure.value).startswith("here: ")
    assert "\n" not in str(failure.value)


def test_of_another_owner() -> None:
    data = encode(owner({"seed": 1}, 1), Saved(0, 1))
    with pytest.raises(InputError, match="another run or another scenario"):
        decode(data, ME, "here")


def test_no_file_is_no_checkpoint(tmp_path) -> None:
    assert load(tmp_path / "none", ME) is None
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path, ME)
