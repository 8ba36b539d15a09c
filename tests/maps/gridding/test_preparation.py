"""What is done to readings before they are gridded."""

import numpy as np
import pytest

from helpers.surveys import flight_lines, scattered, survey_at
from isogal.errors import InputError
from isogal.maps.gridding.levelling import cross_overs, levelled
from isogal.maps.gridding.reduction import block_reduced


def plane(places):
    return 1e-5 * (3.0 + places[:, 0] / 5e3 - places[:, 1] / 4e3)


def test_levelling_finds_the_offsets_of_lines():
    east, _ = flight_lines(5, 2000.0, 370.0, 6e3)
    places = np.concatenate([east, east[:, ::-1] + 113.0])
    line = np.repeat(np.arange(10), len(east) // 5)
    offset = 1e-5 * np.random.default_rng(1).standard_normal(10)
    survey = survey_at(places, plane(places) + offset[line], line=line)
    before = cross_overs(survey)
    assert before.difference.size == 25
    level, left = levelled(survey, before)
    after = cross_overs(level)
    assert after.figures()["rms"] == pytest.approx(left["rms"])
    assert 15.0 < left["degrees_of_freedom"] < 16.5
    assert after.figures()["rms"] < 0.02 * before.figures()["rms"]
    np.testing.assert_allclose(
        before.difference,
        offset[before.first] - offset[before.second],
        atol=1e-8,
    )


def test_parallel_lines_cannot_be_levelled():
    places, line = flight_lines(4, 2000.0, 300.0, 5e3)
    survey = survey_at(places, plane(places), line=line)
    with pytest.raises(InputError, match="no two lines cross"):
        levelled(survey, cross_overs(survey))


def test_blocks_are_means_of_each_line():
    places = scattered(900, 5e3, seed=4)
    line = np.arange(900) % 2
    survey = survey_at(places, plane(places), line=line, sigma=np.full(900, 2e-6))
    blocks = block_reduced(survey, 1000.0)
    assert 190 <= len(blocks) <= 242
    assert blocks.value.mean() == pytest.approx(survey.value.mean(), abs=5e-7)
    assert np.median(blocks.sigma) == pytest.approx(2e-6 / np.sqrt(4.1), rel=0.2)
    assert block_reduced(survey, 0.0) is survey
    with pytest.raises(InputError, match=r"blocks of 1e\+09 m .* leave"):
        block_reduced(survey, 1e9)
