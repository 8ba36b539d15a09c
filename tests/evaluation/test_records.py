from dataclasses import fields, replace

import numpy as np
import pytest

from helpers.studies import outcomes
from isogal.errors import InputError
from isogal.evaluation.records import RunDetail, Runs


def assert_equal(a, b):
    for item in fields(a):
        x, y = getattr(a, item.name), getattr(b, item.name)
        if isinstance(x, RunDetail):
            assert_equal(x, y)
        else:
            np.testing.assert_array_equal(x, y)


def declining(runs):
    reasons, error = runs.fix_reason.astype("U40"), runs.fix_error.copy()
    reasons[0, 1], reasons[-1, -1] = "the map is flat here: γ below 0.1", "no reading"
    error[0, 1] = error[-1, -1] = np.nan
    return replace(runs, fix_error=error, **outcomes(reasons))


def smoothed(runs):
    states = {"smoothed_error": 0.5 * runs.error, "smoothed_covariance": 0.25 * runs.covariance}
    return replace(runs, **states)


def test_a_file_gives_back_what_was_saved_and_equal_runs_give_equal_files(make_runs, tmp_path):
    first, second = tmp_path / "deeper" / "a.npz", tmp_path / "deeper" / "b.npz"
    for path in (first, second):
        smoothed(declining(make_runs(detail=True))).save(path)
    assert_equal(Runs.load(first), smoothed(declining(make_runs(detail=True))))
    assert first.read_bytes() == second.read_bytes()
    assert sorted(first.parent.iterdir()) == [first, second]
    make_runs(batches=0).save(first)
    assert Runs.load(first).published.shape == (3, 0)


def test_joined_chunks_are_the_whole(make_runs):
    whole = smoothed(declining(make_runs(runs=5, detail=True)))
    parts = [whole.part(rows) for rows in (range(2), [2], range(3, 5))]
    assert_equal(Runs.concatenate(parts), whole)
    assert [part.detail is None for part in parts] == [False, True, True]


def test_damaged_files_are_refused_in_one_line(make_runs, tmp_path):
    path = tmp_path / "chunk.npz"
    make_runs().save(path)
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(flipped) // 2] ^= 0xFF
    for damaged in (whole[: len(whole) // 2], b"", b"not an archive", bytes(flipped)):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"chunk\.npz") as caught:
            Runs.load(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="No such file"):
        Runs.load(tmp_path / "missing.npz")


def test_a_file_of_another_version_is_refused(make_runs, tmp_path):
    make_runs().save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as stored:
        np.savez(tmp_path / "b.npz", **(dict(stored) | {"format": np.array(99)}))
    with pytest.raises(InputError, match="format 99"):
        Runs.load(tmp_path / "b.npz")
