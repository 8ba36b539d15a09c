"""A run that is watched: what is read of a bag that grows, the live page, the dashboard."""

import io
import json
import shutil
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

pytest.importorskip("bokeh", reason="needs bokeh, which draws the page")

from rich.console import Console

from helpers.command_line import answer, refusal
from isogal.fields.scenario_map import map_for_scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector
from isogal_ros.graph.running import Progress
from isogal_ros.graph.watching import Watch, picture, serve


@pytest.fixture
def watch(recording) -> Watch:
    scenario = BagReader(recording).scenario()
    trajectory = build_trajectory(scenario)
    return Watch(scenario, trajectory, map_for_scenario(scenario, trajectory), recording)


def test_a_bag_that_grows_is_taken_once(watch, recording, tmp_path) -> None:
    reader = BagReader(recording)
    whole, folder = Collector(reader.scenario()), tmp_path / "bag"
    whole.take_bag(reader)
    data = reader.files[0].read_bytes()
    it = Watch(reader.scenario(), watch.trajectory, watch.field_map, folder)
    assert it.look() == (0, None)
    folder.mkdir()
    counts = []
    for share in (0.001, 0.3, 0.301, 0.8, 1.0, 1.0):
        (folder / "bag_0.mcap").write_bytes(data[: int(share * len(data))])
        counts.append(it.look()[0])
    assert counts[1] < counts[3] < counts[4] == counts[5]
    growing = it.collector
    assert growing.last_nav == whole.last_nav
    assert growing.candidates == whole.candidates
    assert growing.said == whole.said


def test_the_live_page(watch) -> None:
    with serve(watch) as address:
        assert address.startswith("http://127.0.0.1:")
        with urlopen(address) as page:
            assert 'data-live="true"' in page.read().decode()
        with urlopen(address + "state?seen=") as state:
            tag, data = state.headers["ETag"], json.load(state)
            assert state.headers["X-Status"] == "starting"
        assert len(data["states"]["t"]) == 37
        watch.progress = Progress(180.0, 360.0, 50.0, 12.0)
        with urlopen(f"{address}state?seen={tag}") as again:
            assert again.status == 204
            assert again.headers["X-Status"] == "running: 50% of 360 s, 50 x real time, error 12 m"
        for path, host, status in (("", "evil.example", 403), ("elsewhere", None, 404)):
            with pytest.raises(HTTPError, match=str(status)):
                urlopen(Request(address + path, headers={"Host": host} if host else {}))
    with pytest.raises(OSError, match="refused"):
        urlopen(address)


def test_the_dashboard(watch) -> None:
    screen = io.StringIO()
    console = Console(file=screen, width=120)
    console.print(picture(None, None))
    _, viewed = watch.look()
    console.print(picture(Progress(180.0, 360.0, 50.0, 12.0), viewed))
    text = screen.getvalue()
    assert "Waiting for the first reading" in text
    for words in ("50% of 360 s", "protection level", "unaided INS", "6 min"):
        assert words in text


def test_a_runs_folder_as_a_page(recording, tmp_path) -> None:
    shutil.copytree(recording, tmp_path / "run" / "bag")
    answer("view", tmp_path / "run", "--out", tmp_path / "view.html")
    assert "<h1>run</h1>" in (tmp_path / "view.html").read_text(encoding="utf-8")
    assert "--run" in refusal("view", recording, "--run", 1)
