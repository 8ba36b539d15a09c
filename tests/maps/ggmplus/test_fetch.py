"""Fetching tiles from a local HTTP server with the faults of a mirror."""

import hashlib
import socket

import numpy as np
import pytest

from helpers.mirror import serving
from helpers.refusals import refusal
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.cache import locked
from isogal.maps.corridor import corridor_of
from isogal.maps.ggmplus.fetch import REGISTRY, fetch_tiles, read_registry, tiles_for

CELLS = 100  # tiles of 20 kB instead of 12.5 MB
NAME = "S40E145.dg"
OFFLINE = r"cannot be reached .*; offline\?; gave up after 3 tries$"


@pytest.fixture
def mirror(monkeypatch):
    monkeypatch.setattr("isogal.maps.ggmplus.fetch.CELLS", CELLS)
    monkeypatch.setattr("isogal.maps.ggmplus.fetch._PAUSE", 0.01)
    rng = np.random.default_rng(7)
    with serving({name: rng.bytes(2 * CELLS * CELLS) for name in (NAME, "S40E140.dg")}) as server:
        yield server


@pytest.fixture
def fetch(mirror, tmp_path):
    """Fetches tiles from the mirror, or another address."""

    def fetch(*names, url=mirror.url, **more):
        return fetch_tiles(list(names or [NAME]), url, tmp_path, timeout=0.4, tries=3, **more)

    return fetch


def left(folder):
    return sorted(p.name for p in folder.iterdir() if not p.name.endswith(".lock"))


def test_tiles_arrive_whole_with_progress_and_checksums(mirror, fetch, tmp_path):
    seen = []
    names = [NAME, "S40E140.dg", "S45E145.dg"]
    result = fetch(*names, url=mirror.url + "/", progress=lambda *a: seen.append(a))
    assert result.downloaded == result.trusted == names[:2]
    assert (result.absent, result.present) == (names[2:], [])
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME]
    assert left(tmp_path) == sorted([*names[:2], REGISTRY])
    known = read_registry(tmp_path / REGISTRY)
    assert known[NAME] == hashlib.sha256(mirror.files[NAME]).hexdigest()
    assert sorted(known) == sorted(result.downloaded)
    assert seen[-1] == ("S40E140.dg", 2 * CELLS * CELLS, 2 * CELLS * CELLS)
    assert mirror.requests[0][0] == f"/data/dg/{NAME}"
    again = fetch()
    assert (again.present, again.downloaded, again.trusted) == ([NAME], [], [])
    assert len(mirror.requests) == 3  # none for what is there
    mirror.files[names[2]] = mirror.files[NAME]
    assert fetch(*names).downloaded == names[2:]  # once it is there


def test_a_tile_put_there_by_hand_is_trusted_on_first_use(mirror, fetch, tmp_path):
    (tmp_path / NAME).write_bytes(mirror.files[NAME])
    result = fetch()
    assert (result.present, result.trusted, mirror.requests) == ([NAME], [NAME], [])


@pytest.mark.parametrize(
    "trouble",
    [
        ["cut", "cut", "cut", "cut", "cut", "cut"],
        ["stall"],
        [503, 429, "cut"],
        ["cut", "lies"],
        ["cut", "no resume"],
    ],
    ids=str,
)
def test_temporary_server_errors_are_retried(mirror, fetch, tmp_path, trouble):
    mirror.trouble[NAME] = list(trouble)
    assert fetch().downloaded == [NAME]
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME]
    assert left(tmp_path) == sorted([NAME, REGISTRY])
    if trouble[0] == "cut":
        assert mirror.requests[1][1] == f"bytes={CELLS * CELLS}-"


def test_a_later_call_goes_on_where_the_first_broke_off(mirror, fetch, tmp_path):
    mirror.trouble[NAME] = ["cut", 503, 503, 503]
    with pytest.raises(InputError, match=r"answers 503 .*; gave up after 3 tries"):
        fetch()
    assert NAME not in left(tmp_path)
    mirror.requests.clear()
    fetch()
    assert mirror.requests == [(f"/data/dg/{NAME}", f"bytes={CELLS * CELLS}-")]
    assert (tmp_path / NAME).read_bytes() == mirror.files[NAME]


@pytest.mark.parametrize(
    "trouble,words",
    [
        (["shorter"], "the server's file has 19900 bytes, a tile has 20000; wrong address?"),
        (["no length"], "the server's file has 20007 bytes, a tile has 20000"),
        ([403], "the server answers 403"),
        (["slow"] * 9, "no answer within 0.4 s; gave up after 3 tries"),
        ([404], "the server has none of the 1 tiles"),
    ],
)
def test_permanent_server_errors_are_reported(mirror, fetch, tmp_path, trouble, words):
    mirror.trouble[NAME] = list(trouble)
    seen = []
    with refusal(words):
        fetch(progress=lambda *a: seen.append(a))
    assert all(done <= total for _, done, total in seen)
    assert NAME not in left(tmp_path)


def test_no_network_is_one_clear_line(fetch):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for url in (f"http://127.0.0.1:{port}", "http://no-such-host.invalid"):
        with pytest.raises(InputError, match=OFFLINE):
            fetch(url=url)


def test_addresses_begin_with_http(fetch):
    for url in ("file:///etc", "curtin.edu", ""):
        with refusal("must begin with http"):
            fetch(url=url)


def test_another_edition_is_refused_and_damage_repaired(mirror, fetch, tmp_path):
    good = mirror.files[NAME]
    fetch()
    (tmp_path / NAME).write_bytes(good[:-1] + b"?")
    assert fetch().downloaded == [NAME]
    assert (tmp_path / NAME).read_bytes() == good
    (tmp_path / NAME).unlink()
    mirror.files[NAME] = bytes(len(good))
    words = r"differs from the checksum of its first download in .*checksums\.txt"
    with pytest.raises(InputError, match=words):
        fetch()
    assert left(tmp_path) == [REGISTRY]


def test_one_fetch_at_a_time_with_a_registry_that_can_be_read(fetch, tmp_path):
    with (
        locked(tmp_path / "fetch", wait=False) as mine,
        pytest.raises(InputError, match="another isogal map fetch is at work"),
    ):
        assert mine
        fetch()
    (tmp_path / REGISTRY).write_text("# head\nwhat is this\n")
    with pytest.raises(InputError, match=r"checksums\.txt \(line 2\)"):
        fetch()


def test_tiles_of_the_default_route():
    lat, lon = np.radians([-38.0, -35.0]), np.radians([144.5, 150.0])
    assert tiles_for(corridor_of(lat, lon), ["ga"]) == [
        f"{name}.ga" for name in ("S40E140", "S40E145", "S40E150", "S35E145", "S35E150")
    ]
    long_way = corridor_of(np.radians([-39.0, -21.0]), np.radians([141.0, 154.0]))
    assert len(tiles_for(long_way, ["dg"])) < len(tiles_for(long_way.window, ["dg"]))
    with pytest.raises(InputError, match="--variable zz"):
        tiles_for(Window(0.0, 0.1, 0.0, 0.1), ["zz"])
