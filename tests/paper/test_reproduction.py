"""`isogal paper` in miniature: two runs of twenty minutes on a small map."""

import json
import re

import pytest

from helpers.command_line import answer, refusal
from isogal.paper.claims import FAILS, HOLDS, OPEN
from isogal.paper.published import ROWS

FIGURES = ["51", "52", "54", "54a", "56", "56a", "56b", "57", "60", "61", "61a", "64"]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def words(out, map_, *more):
    given = ["--out", out, "--map", map_, "--runs", 2, "--duration", 1200]
    return ["paper", *given, *more]


@pytest.fixture(scope="module")
def page(two_maps, tmp_path_factory):
    out = tmp_path_factory.mktemp("paper")
    assert "2 runs a case" in answer(*words(out, two_maps))
    return out


def test_every_figure_is_there_alone_and_in_the_page(page):
    for name in FIGURES:
        assert (page / f"fig-{name}.png").stat().st_size > 15_000, name
    html = (page / "report.html").read_text()
    assert html.count("<img") == len(FIGURES)
    for name in FIGURES:
        assert f"Paper fig. {name}." in html
    assert not re.search(r'src="(?!data:)', html)


def test_every_row_and_claim_is_there(page):
    document = json.loads((page / "results.json").read_text())
    rows = [row for table in ("4", "6") for row in document["tables"][table]]
    published = [(row.batch_length, row.sigma) for row in ROWS]
    assert [(row["batch_length"], row["sigma"]) for row in rows] == published
    for row in rows:
        for matcher in ("pmht-paper", "pmht"):
            assert row[matcher]["mean"] > 0.0
            assert 0.0 <= row[matcher]["divergence_rate"] <= 1.0
    assert len(document["unaided"]) == 3
    assert len(document["claims"]) >= 20
    html = (page / "report.html").read_text()
    for claim in document["claims"]:
        assert claim["verdict"] in (HOLDS, FAILS, OPEN)
        assert claim["measured"]
        assert claim["where"] in html
    assert "nan" not in json.dumps(document["claims"]).lower()


def test_map_that_does_not_cover_the_route_is_one_line(two_maps, tmp_path):
    line = refusal(*words(tmp_path / "out", two_maps, "--duration", 9000))
    assert re.fullmatch(r"isogal: --map: .*does not cover the route.*\n", line)
    assert not (tmp_path / "out").exists()
