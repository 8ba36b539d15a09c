import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from helpers.route_maps import made_up
from helpers.studies import outcomes
from isogal.evaluation.bound import BoundResult
from isogal.evaluation.figures import style
from isogal.evaluation.figures.errors import error_figure
from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.evaluation.run_report import key_figures, run_report
from isogal.evaluation.summary import summarise
from isogal.scenario import Scenario

FIELD = made_up(provenance="made up <for> tests")
VOID = {"meta", "img", "br", "link"}


class Page(HTMLParser):
    """Checks nesting and collects what is in the page."""

    def __init__(self, text):
        super().__init__()
        self.stack: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.stack == []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if self.stack[-1:] != ["style"]:
            self.text += data

    def all(self, tag):
        return [attributes for name, attributes in self.found if name == tag]


@pytest.fixture(scope="module", autouse=True)
def coarse_pictures():
    """Pictures of a quarter of the size, for speed; test_figures checks full ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "DPI", 40)
        yield


def write(runs, folder):
    bound = BoundResult(np.arange(121) * 60.0, np.broadcast_to(400.0 * np.eye(2), (121, 2, 2)))
    summary = summarise(runs, Scenario(), bound.rms_at(runs.time - runs.time[0]))
    assert all(cell for row in key_figures(summary).rows for cell in row)
    return run_report(runs, Scenario(), FIELD, bound, folder, summary)


def test_the_page_is_whole_and_refers_to_nothing_outside(make_runs, tmp_path):
    figure = Illustration("errors", error_figure(make_runs(runs=1)), "North & east.")
    sections = [
        Section("Errors", ["A paragraph."], [figure], listing="a: 1"),
        Section("More", tables=[Table("Folded.", ("a",), [("1",)], folded=True)]),
    ]
    numbers = Table("Numbers.", ("what", "m"), [("x", "1.5")])
    path = write_report(tmp_path / "out", "Title", sections, [numbers])
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert not re.search(r"https?://|//cdn|<script|<link|url\(", text)
    (image,) = page.all("img")
    assert image["alt"] == "North & east."
    data = base64.b64decode(str(image["src"]).removeprefix("data:image/png;base64,"))
    assert data == (tmp_path / "out" / "errors.png").read_bytes()
    assert all(name in page.text for name in ("Table 1.", "Table 2.", "Figure 1."))


def test_text_is_escaped(tmp_path):
    nasty = '<script>alert(1)</script> & "quotes" {{ 7 * 7 }}'
    table = Table(nasty, (nasty,), [(nasty,)])
    section = Section(nasty, [nasty], tables=[table], listing=nasty)
    text = write_report(tmp_path, nasty, [section], subtitle=nasty).read_text(encoding="utf-8")
    assert "<script" not in text and "49" not in text
    assert Page(text).text.count("alert(1)") >= 6


EVERY_RUN = {"track", "north_east_error", "nees", "position_error", "stanford"}


def test_the_report_of_a_run_whenever_it_started(make_runs, tmp_path):
    runs = make_runs(runs=1, detail=True)
    page = Page(write(runs, tmp_path / "a").read_text(encoding="utf-8"))
    assert {p.stem for p in (tmp_path / "a").glob("*.png")} == EVERY_RUN | {"measured"}
    assert len(page.all("img")) == len(EVERY_RUN) + 1
    assert number(np.sqrt(np.mean(runs.horizontal_error**2))) in page.text
    for text in ("made up <for> tests", "Every batch gave a fix.", "batch_length: 30"):
        assert text in page.text
    shift = 2.0**20
    detail = replace(runs.detail, scan_time=runs.detail.scan_time + shift)
    later = replace(runs, time=runs.time + shift, fix_time=runs.fix_time + shift, detail=detail)
    write(later, tmp_path / "b")
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name


def test_the_report_of_many_runs_says_why_batches_gave_no_fix(make_runs, tmp_path):
    reasons = ["flat (misfit 1.5e-3 per degree)", "flat (misfit 27.1 per degree)", *[""] * 22]
    runs = make_runs(runs=3, **outcomes([reasons] * 3))
    page = Page(write(runs, tmp_path).read_text(encoding="utf-8"))
    assert page.text.count("flat (misfit … per degree)") == 1
    assert page.text.count("consistent") == 4  # nothing is beyond the level in 6 h, nor has to be
    assert "3 runs" in page.text and "66 / 6" in page.text
    assert {p.stem for p in tmp_path.glob("*.png")} == EVERY_RUN


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (0.0, "0"),
        (1234.5, "1234"),
        (99.96, "100"),
        (0.01234, "0.0123"),
        (1.2e-5, "1.20e-05"),
        (-61.04, "-61.0"),
        (3.4e7, "3.40e+07"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text
