"""Fetching tiles from a local HTTP server with the faults of a mirror."""

import contextlib
import hashlib
import socket
import threading
import time
from collections import defaultdict
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.cache import locked
from isogal.maps.corridor import corridor_of
from isogal.maps.ggmplus.download import Patience
from isogal.maps.ggmplus.fetch import REGISTRY, fetch_tiles, read_registry, tiles_for

CELLS = 100  # tiles of 20 kB instead of 12.5 MB
NAME = "S40E145.dg"
QUICK = Patience(timeout=0.4, tries=3, pause=0.01)


class Mirror(ThreadingHTTPServer):
    """Serves ``files``; each request to a path first takes the next entry of its ``trouble``."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.files = {}
        self.trouble = defaultdict(list)
        self.requests = []
        self.url = f"http://127.0.0.1:{self.server_address[1]}/data"

    def handle_error(self, request, client_address):
        """Be silent about clients that hang up."""


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        """Be silent."""

    def do_GET(self):
        self.close_connection = True
        name = self.path.rpartition("/")[2]
        self.server.requests.append((self.path, self.headers.get("Range")))
        what = self.server.trouble[name].pop(0) if self.server.trouble[name] else "good"
        body = self.server.files.get(name)
        if isinstance(what, int):
            self.send_error(what)
            return
        if body is None:
            self.send_error(404)
            return
        start = 0
        asked = self.headers.get("Range")
        if what == "slow":
            time.sleep(1.0)
        if asked and what != "no resume":
            start = int(asked.removeprefix("bytes=").rstrip("-"))
            if start >= len(body):
                self.send_error(416)
                return
        if what == "lies":
            start = 7
        self.send_response(206 if start else 200)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(body) - 1}/{len(body)}")
        rest = body[start:]
        if what == "shorter":
            rest = rest[:-100]
        if what == "no length":
            rest += b"surplus"
        else:
            self.send_header("Content-Length", str(len(rest)))
        self.end_headers()
        if what == "cut":
            self.wfile.write(rest[: len(rest) // 2])
            self.wfile.flush()
            self.connection.shutdown(socket.SHUT_RDWR)
        elif what == "stall":
            self.wfile.write(rest[:1000])
            self.wfile.flush()
            time.sleep(1.0)
        else:
            self.wfile.write(rest)


@pytest.fixture
def mirror(monkeypatch):
    monkeypatch.setattr("isogal.maps.ggmplus.fetch.CELLS", CELLS)
    server = Mirror()
    rng = np.random.default_rng(7)
    server.files = {name: rng.bytes(2 * CELLS * CELLS) for name in (NAME, "S40E140.dg")}
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def left(folder):
    return sorted(p.name for p in folder.iterdir() if not p.name.endswith(".lock"))


def test_tiles_arrive_whole_with_progress_and_checksums(mirror, tmp_path):
    seen = []
    result = fetch_tiles(
        [NAME, "S40E140.dg", "S45E145.dg"],
        mirror.url + "/",
        tmp_path,
        patience=QUICK,
        progress=lambda *a: seen.append(a),
    )
    assert (result.downloaded, result.absent, result.present) == (
        [NAME, "S40E140.dg"],
        ["S45E145.dg"],
        [],
    )
    assert result.trusted == result.downloaded
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME]
    assert left(tmp_path) == sorted([NAME, "S40E140.dg", REGISTRY])
    known = read_registry(tmp_path)
    assert known[NAME] == hashlib.sha256(mirror.files[NAME]).hexdigest()
    assert sorted(known) == sorted(result.downloaded)
    assert seen[-1] == ("S40E140.dg", 2 * CELLS * CELLS, 2 * CELLS * CELLS)
    assert mirror.requests[0][0] == f"/data/dg/{NAME}"


def test_what_is_there_is_not_fetched_again(mirror, tmp_path):
    fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    again = fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    assert (again.present, again.downloaded, again.trusted) == ([NAME], [], []) and len(
        mirror.requests
    ) == 1


def test_a_tile_put_there_by_hand_is_trusted_on_first_use(mirror, tmp_path):
    (tmp_path / NAME).write_bytes(mirror.files[NAME])
    result = fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    assert (result.present, result.trusted, mirror.requests) == ([NAME], [NAME], [])


@pytest.mark.parametrize(
    "trouble",
    [
        ["cut"],
        ["cut", "cut", "cut", "cut", "cut", "cut"],
        ["stall"],
        ["slow"],
        [503, 429, "cut"],
        ["cut", "lies"],
    ],
    ids=str,
)
def test_temporary_server_errors_are_retried(mirror, tmp_path, trouble):
    mirror.trouble[NAME] = list(trouble)
    assert fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK).downloaded == [NAME]
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME] and left(tmp_path) == sorted(
        [NAME, REGISTRY]
    )
    if trouble[0] == "cut":
        assert mirror.requests[1][1] == f"bytes={CELLS * CELLS}-"


def test_a_later_call_goes_on_where_the_first_broke_off(mirror, tmp_path):
    mirror.trouble[NAME] = ["cut", 503, 503, 503]
    with pytest.raises(InputError, match=r"answers 503 .*; gave up after 3 tries"):
        fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    assert NAME not in left(tmp_path)
    mirror.requests.clear()
    fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    assert mirror.requests == [(f"/data/dg/{NAME}", f"bytes={CELLS * CELLS}-")]
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME]


def test_a_server_that_does_not_resume(mirror, tmp_path):
    mirror.trouble[NAME] = ["cut", "no resume"]
    fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME]


@pytest.mark.parametrize(
    "trouble,words",
    [
        (["shorter"], "the server's file has 19900 bytes, a tile has 20000; wrong address?"),
        (["no length"], "sends more than the 20000 bytes of a tile"),
        ([403], "the server answers 403"),
        (["slow"] * 9, "no answer within 0.4 s; gave up after 3 tries"),
        ([500] * 9, "the server answers 500"),
        ([404], "the server has none of the 1 tiles"),
    ],
)
def test_permanent_server_errors_are_reported(mirror, tmp_path, trouble, words):
    mirror.trouble[NAME] = list(trouble)
    seen = []
    with pytest.raises(InputError) as error:
        fetch_tiles(
            [NAME], mirror.url, tmp_path, patience=QUICK, progress=lambda *a: seen.append(a)
        )
    assert words in str(error.value) and "\n" not in str(error.value)
    assert all(done <= total for _, done, total in seen)
    assert NAME not in left(tmp_path)


def test_offline_is_one_clear_line(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for url in (f"http://127.0.0.1:{port}", "http://no-such-host.invalid"):
        with pytest.raises(
            InputError, match=r"cannot be reached .*; offline\?; gave up after 3 tries"
        ) as error:
            fetch_tiles([NAME], url, tmp_path, patience=QUICK)
        assert "\n" not in str(error.value)


def test_another_edition_is_refused_and_damage_repaired(mirror, tmp_path):
    good = mirror.files[NAME]
    fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    (tmp_path / NAME).write_bytes(good[:-1] + b"?")
    assert fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK).downloaded == [NAME]
    assert (tmp_path / NAME).read_bytes() == good
    (tmp_path / NAME).unlink()
    mirror.files[NAME] = bytes(len(good))
    with pytest.raises(
        InputError, match=r"differs from the checksum of its first download in .*checksums\.txt"
    ):
        fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)
    assert left(tmp_path) == [REGISTRY]


def test_a_tile_that_appears_later_is_fetched(mirror, tmp_path):
    good = mirror.files.pop(NAME)
    fetch_tiles([NAME, "S40E140.dg"], mirror.url, tmp_path, patience=QUICK)
    mirror.files[NAME] = good
    assert fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK).downloaded == [NAME]


def test_one_fetch_at_a_time(mirror, tmp_path):
    with contextlib.ExitStack() as stack:
        assert stack.enter_context(locked(tmp_path / "fetch", wait=False))
        with pytest.raises(InputError, match="another isogal map fetch is at work"):
            fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)


@pytest.mark.parametrize("url", ["ftp://x/y", "file:///etc", "ddfe.curtin.edu.au", ""])
def test_only_http_addresses(tmp_path, url):
    with pytest.raises(InputError, match="must begin with http"):
        fetch_tiles([NAME], url, tmp_path, patience=QUICK)


def test_a_broken_registry_is_named(mirror, tmp_path):
    (tmp_path / REGISTRY).write_text("# head\nwhat is this\n")
    with pytest.raises(InputError, match=r"checksums\.txt \(line 2\)"):
        fetch_tiles([NAME], mirror.url, tmp_path, patience=QUICK)


def test_tiles_of_the_default_route():
    lat, lon = np.radians([-38.0, -35.0]), np.radians([144.5, 150.0])
    assert tiles_for(corridor_of(lat, lon), ["ga"]) == [
        f"{name}.ga" for name in ("S40E140", "S40E145", "S40E150", "S35E145", "S35E150")
    ]
    long_way = corridor_of(np.radians([-39.0, -21.0]), np.radians([141.0, 154.0]))
    assert len(tiles_for(long_way, ["dg"])) < len(tiles_for(long_way.window, ["dg"]))
    with pytest.raises(InputError, match="--variable zz"):
        tiles_for(Window(0.0, 0.1, 0.0, 0.1), ["zz"])
