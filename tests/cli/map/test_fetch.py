"""`isogal map fetch` from a server on this machine."""

import json
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from helpers.command_line import answer

ROUTE = ("--route", "-38,144 -38,146")


class Mirror(BaseHTTPRequestHandler):
    """Holds the tiles of one place: 4 bytes a cell of gravity, 2 of its disturbance."""

    def do_GET(self):
        there = "S40E145" in self.path
        self.send_response(200 if there else 404)
        size = 40_000 if self.path.endswith(".ga") else 20_000
        self.send_header("Content-Length", str(size) if there else "0")
        self.end_headers()
        if there:
            self.wfile.write(bytes(size))

    def log_message(self, *_):
        """Print nothing."""


@pytest.fixture
def mirror(monkeypatch):
    monkeypatch.setattr("isogal.maps.ggmplus.fetch.CELLS", 100)
    with HTTPServer(("127.0.0.1", 0), Mirror) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def test_tiles_are_fetched_once(mirror, tmp_path):
    words = ("map", "fetch", "--base-url", mirror, "--out", tmp_path / "g", "--variable", "dg")
    found = json.loads(answer(*words, *ROUTE, "--json"))
    assert (found["downloaded"], found["absent"]) == (["S40E145.dg"], ["S40E140.dg"])
    text = answer(*words, *ROUTE)
    assert "S40E145.dg  there already" in text
    assert "S40E140.dg  not on the server" in text
    assert text.endswith(f"map.source: {tmp_path / 'g'}\n")


def test_the_field_of_the_scenario_names_the_tiles(mirror, tmp_path):
    words = ("map", "fetch", "--base-url", mirror, "--out", tmp_path / "g", *ROUTE)
    assert "S40E145.ga  fetched, trusted on first use" in answer(*words)
    assert "S40E145.dg  fetched" in answer(*words, "--set", "gravimeter.quantity=disturbance")
