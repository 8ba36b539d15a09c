"""The page of `isogal view`: what is in it, and what it does in a browser."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="needs bokeh, which draws the page")

from helpers.browser import CHROMIUM, chromium
from helpers.studies import outcomes, small_scenario, wavy_map
from isogal.evaluation.view.page import Frame, write_view
from isogal.evaluation.view.record import Event, ViewedRun

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: chromium)")


@pytest.fixture(scope="module")
def viewed(make_runs):
    runs = make_runs(
        runs=1,
        detail=True,
        latitude=np.radians(np.linspace(-38.0, -37.7, 121)),
        longitude=np.radians(np.linspace(144.5, 144.9, 121)),
        **outcomes([[""] * 20 + ["the posterior has several peaks"] * 4]),
    )
    events = [
        Event(60.0, "WARN", "pmht_mm_node", "</script> late"),
        Event(61.0, "WARN", "pmht_mm_node", "</script> late"),
        Event(900.0, "ERROR", "ins_sim_node", "stopped"),
    ]
    return ViewedRun(runs, small_scenario(), "A run <b>", "with a subtitle", events)


@pytest.fixture(scope="module")
def page(viewed, tmp_path_factory):
    return write_view(tmp_path_factory.mktemp("view") / "made" / "view.html", viewed, wavy_map())


def numbers(page):
    text = page.read_text(encoding="utf-8")
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def test_the_page_is_one_file_that_asks_nobody(page):
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 4e6
    frame = re.sub(r"(<script[^>]*>).*?</script>", r"\1", text, flags=re.DOTALL)
    assert re.findall(r'(?:src|href)="(?!data:)[^"#]', frame) == []
    assert "<h1>A run &lt;b&gt;</h1>" in text


def test_the_numbers_are_those_of_the_run(page, viewed):
    data, runs = numbers(page), viewed.runs
    states, batches = data["states"], data["batches"]
    np.testing.assert_allclose(states["error"], runs.horizontal_error[0], rtol=1e-4)
    np.testing.assert_allclose(np.array(states["t"]) * 3600.0, runs.time, atol=1e-2)
    moved = np.hypot(
        np.subtract(states["aided_x"], states["x"]), np.subtract(states["aided_y"], states["y"])
    )
    np.testing.assert_allclose(1e3 * moved, runs.horizontal_error[0], rtol=5e-3, atol=0.1)
    assert batches["reason"][19:21] == [None, "the posterior has several peaks"]
    assert [len(found["x"]) for found in data["candidates"]] == [15] * 24
    assert data["events"]["times"] == [2, 1]
    assert data["events"]["text"] == ["</script> late", "stopped"]


def test_a_live_page_is_complete_without_numbers(viewed):
    runs = viewed.runs
    frame = Frame.of("Live", "", 2.0, (runs.latitude, runs.longitude), wavy_map(), live=True)
    text = frame.page(None)
    assert ">null</script>" in text
    assert 'data-live="true"' in text


def place(browser, figure):
    browser.value(f"document.querySelector('#figure_{figure}').scrollIntoView({{block:'center'}})")
    return browser.value(
        f"(() => {{ const r = document.querySelector('#figure_{figure} .bk-Figure')"
        ".getBoundingClientRect(); return {x: r.x, y: r.y, w: r.width, h: r.height}; })()"
    )


INDEX, MODEL = "isogalView.index", "Bokeh.documents[0].get_model_by_name"


@pytest.fixture
def browser(tmp_path):
    with chromium(tmp_path / "profile") as running:
        yield running
        assert running.told == []
        assert [url for url in running.requests if not url.startswith(("file:", "data:"))] == []


@needs_browser
def test_the_page_in_a_browser(page, browser):
    browser.open(page.as_uri())
    assert browser.value(INDEX) == 0
    keyboard(browser)
    slider(browser)
    pointer(browser)
    narrow(browser)


@needs_browser
def test_without_the_truth_no_error_is_shown(viewed, browser, tmp_path):
    page = write_view(tmp_path / "view.html", replace(viewed, is_true=False), wavy_map())
    browser.open(page.as_uri())
    browser.press("n")
    said = browser.value("document.getElementById('readout').innerText")
    assert "claimed sigma" in said
    assert not {"error", "NEES", "truth"} & set(re.findall(r"\w+", said))
    assert browser.value("document.getElementById('figure_nees').hidden")
    shown = "[...document.querySelectorAll('.key')].filter(k => !k.hidden)"
    names = browser.value(f"{shown}.map(k => k.textContent)")
    assert "true track" not in names
    assert "claimed, 1 sigma" in names
    assert browser.value(f"{MODEL}('tracks').data.x.every(Number.isNaN)")
    assert browser.value(f"{MODEL}('states').data.unaided.every(Number.isNaN)")
    assert browser.value(f"{MODEL}('tracks').data.unaided_x.some(Number.isFinite)")


def keyboard(browser):
    """A state on, the next fix, the end; the cursor and the map go along."""
    browser.press("ArrowRight")
    assert browser.value(INDEX) == 1
    browser.press("n")
    assert browser.value("document.getElementById('clock').textContent") == "0:05:00"
    assert browser.value(f"{MODEL}('candidates').data.x.length") == 15
    browser.press("End")
    assert browser.value(INDEX) == 120
    assert browser.value(f"{MODEL}('cursor').location") == pytest.approx(2.0)
    middle = "(r => (r.start + r.end) / 2)"
    assert browser.value(f"{middle}({MODEL}('close_up').x_range)") == pytest.approx(
        browser.value("isogalView.data.states.x[120]")
    )


def slider(browser):
    """The slider by itself, and playing."""
    browser.value("(s => {s.value = 40; s.dispatchEvent(new Event('input'))})(time)")
    assert browser.value(INDEX) == 40
    browser.press(" ")
    browser.until(f"{INDEX} > 40")
    browser.press(" ")
    assert browser.value("play.textContent") == "Play"


def pointer(browser):
    """A click in a panel moves to its time; panels share their times and the line under the
    pointer. An entry of a key hides its line."""
    stopped, at = browser.value(INDEX), place(browser, "errors")
    browser.click(at["x"] + 0.5 * at["w"], at["y"] + 0.5 * at["h"])
    browser.until(f"{INDEX} !== {stopped}")
    assert 45 <= browser.value(INDEX) <= 75
    assert browser.value(
        f"(p => ['north', 'said'].every(n => {MODEL}(n).toolbar.tools.some("
        f"t => t.overlay === p)))({MODEL}('errors').toolbar.tools.find("
        "t => t.type === 'CrosshairTool').overlay)"
    )
    assert browser.value(f"{MODEL}('north').x_range === {MODEL}('errors').x_range")
    browser.value("document.querySelector('[data-name=\"errors.unaided\"]').click()")
    assert browser.value(f"{MODEL}('errors.unaided').visible") is False


def narrow(browser):
    """In a narrow window nothing is wider than it."""
    browser.resize(360, 700)
    browser.until("document.querySelector('#figure_errors .bk-Figure').offsetWidth <= 360")
    assert browser.value("document.documentElement.scrollWidth") <= 360
