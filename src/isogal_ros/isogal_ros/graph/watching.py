"""A run while it goes on: how far it is, in the terminal, there also what has been recorded so far
(the dashboard), and the page of `isogal view`, served to this machine, which asks for new numbers
each second."""

import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from isogal.errors import InputError
from isogal.evaluation.integrity import level_of
from isogal.evaluation.view.page import Frame
from isogal.evaluation.view.record import ViewedRun
from isogal.maps.channels import RouteMap
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector, wanted_messages
from isogal_ros.bags.viewing import viewed_run
from isogal_ros.graph.running import Progress, Report

TITLE = "Run, live"
HOST = "127.0.0.1"
"""Nobody else can connect."""
LINES_EVERY = 5.0
"""s between lines about the progress where there is no terminal."""
_PER_SECOND = 2.0
"""How often the terminal shows the progress, and what has been recorded."""
_LAST = 6
"""Batches and messages shown."""
_BAR_WIDTH = 20
"""Characters of the bar, which leaves room for words beside it."""


class Watch:
    """What is known of a run that goes on. Several threads may ask.

    Parameters
    ----------
    scenario : Scenario
    trajectory : Trajectory
        The whole route.
    field_map : RouteMap
    folder : Path
        Of the recording.
    """

    def __init__(
        self, scenario: Scenario, trajectory: Trajectory, field_map: RouteMap, folder: Path
    ) -> None:
        self.collector = Collector(scenario)
        self.trajectory, self.field_map = trajectory, field_map
        self.progress: Progress | None = None
        self._folder, self._lock = folder, threading.Lock()
        self._reader: BagReader | None = None
        """None = the recording has not begun."""
        self._messages, self._seen = 0, -1
        self._viewed: ViewedRun | None = None

    def look(self) -> tuple[int, ViewedRun | None]:
        """Return how many messages there are and what they say; None before the first scan."""
        with self._lock:
            with suppress(InputError):  # there is no file yet
                self._reader = self._reader or BagReader(self._folder)
                wanted = self.collector.topics()
                for topic, data in wanted_messages(self._reader, wanted, new=True):
                    self.collector.take(topic, data)
                    self._messages += 1
            if self._messages != self._seen:
                self._viewed = viewed_run(self.collector, self.field_map, TITLE)
                self._seen = self._messages
            return self._seen, self._viewed

    def frame(self) -> Frame:
        """Return the page's frame: the map and the panels of the whole route."""
        route = self.trajectory
        return Frame.of(
            TITLE,
            f"Matcher {self.collector.scenario.matcher.name}",
            float(route.time[-1] - route.time[0]) / 3600.0,
            (route.latitude, route.longitude),
            self.field_map,
            live=True,
        )


@contextmanager
def watching(
    watch: Watch | None = None, *, dashboard: bool = False, port: int | None = None
) -> Iterator[Report]:
    """Yield a function that takes the progress of a run, which is shown as long as the block
    lasts: by a bar or the dashboard on a terminal, else by a line now and then.

    Parameters
    ----------
    watch : Watch, optional
        What dashboard and page show; None = only the progress is shown.
    dashboard : bool
        Whether the terminal shows more than a bar.
    port : int, optional
        Of a page that is served to this machine; 0 = any that is free, None = there is none.

    Raises
    ------
    InputError
        The port is not free, Bokeh is not installed, or standard error is no terminal, which a
        dashboard needs.
    """
    terminal, printed = Console(stderr=True), time.monotonic()
    latest: Progress | None = None

    def report(progress: Progress) -> None:
        nonlocal printed, latest
        if latest is None:
            printed = time.monotonic()  # what is before the first step is no progress
        latest = progress
        if watch is not None:
            watch.progress = progress
        if not terminal.is_terminal and time.monotonic() - printed > LINES_EVERY:
            printed = time.monotonic()
            print(f"  {_words(progress)}", file=sys.stderr, flush=True)

    def look() -> RenderableType:
        if watch is None or not dashboard:
            return _bar(latest)
        return picture(latest, watch.look()[1])

    if dashboard and not terminal.is_terminal:
        raise InputError("--dashboard: standard error is no terminal")
    with ExitStack() as stack:
        if watch is not None and port is not None:
            address = stack.enter_context(serve(watch, port))
            print(f"Live page, on this machine only: {address}", file=sys.stderr, flush=True)
        if terminal.is_terminal:
            # rich calls it from a thread of its own
            live = Live(console=terminal, refresh_per_second=_PER_SECOND, get_renderable=look)
            stack.enter_context(live)
        yield report


def _bar(progress: Progress | None) -> RenderableType:
    """Return a line with a bar."""
    if progress is None:
        return "Starting the nodes ..."
    line = Table.grid(padding=(0, 1))
    bar = ProgressBar(progress.duration, progress.simulated, width=_BAR_WIDTH)
    line.add_row(bar, _words(progress))
    return line


def _words(progress: Progress) -> str:
    """Say how far it is, and the navigator's error where it is known."""
    share, error = progress.simulated / progress.duration, progress.position_error
    known = "" if math.isnan(error) else f", error {error:.0f} m"
    return f"{share:.0%} of {progress.duration:.0f} s, {progress.speed:.0f} x real time{known}"


def picture(progress: Progress | None, viewed: ViewedRun | None) -> Panel:
    """Return the dashboard: progress, errors and what is claimed of them, the last batches and
    messages."""
    parts: list[RenderableType] = [_bar(progress)]
    if viewed is None:
        parts.append("Waiting for the first reading ...")
    else:
        runs, begin = viewed.runs, viewed.runs.time[0]
        figures = Table("", "now", "mean", "most", box=None, pad_edge=False)
        for name, values in (
            ("error", runs.horizontal_error[0]),
            ("claimed, 1 sigma", np.sqrt(np.trace(runs.covariance[0], axis1=1, axis2=2))),
            ("protection level", level_of(runs, viewed.assumed.integrity)[0]),
            ("unaided INS", runs.unaided_horizontal_error[0]),
        ):
            now_mean_most = values[-1], values.mean(), values.max()
            figures.add_row(name, *(f"{value:.0f} m" for value in now_mean_most))
        batches = Table("batch", "fix error", "sigma", "outcome", box=None, pad_edge=False)
        errors = np.linalg.norm(runs.fix_error[0], axis=-1)
        sigmas = np.sqrt(np.trace(runs.fix_covariance[0], axis1=1, axis2=2))
        each = zip(runs.fix_time, errors, sigmas, runs.fix_reason[0], strict=True)
        for time_of, error, sigma, reason in list(each)[-_LAST:]:
            minutes = f"{(time_of - begin) / 60.0:.0f} min"
            batches.add_row(minutes, f"{error:.0f} m", f"{sigma:.0f} m", reason or "fix")
        lines = [
            f"{(event.time - begin) / 60.0:.0f} min  {event.level}  {event.source}: {event.text}"
            for event in (viewed.events or ())[-_LAST:]
        ]
        parts += [figures, batches, Text("\n".join(lines) or "No warnings.")]
    return Panel(Group(*parts), title="isogal run", expand=False)


@contextmanager
def serve(watch: Watch, port: int = 0) -> Iterator[str]:
    """Serve the page as long as the block lasts; yield its address.

    Raises
    ------
    InputError
        The port is not free, or Bokeh is not installed.
    """
    try:
        server = _Server(watch, port)
    except OSError as error:
        raise InputError(f"--port: {port}: {error.strerror}") from None
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    def __init__(self, watch: Watch, port: int) -> None:
        self.watch, self.frame = watch, watch.frame()
        super().__init__((HOST, port), _Handler)


class _Handler(BaseHTTPRequestHandler):
    """Answers ``/``, the page, and ``/state``, its numbers."""

    server: _Server

    def do_GET(self) -> None:
        """Answer one request."""
        address, frame = urlsplit(self.path), self.server.frame
        if self.headers.get("Host", "").rpartition(":")[0] not in (HOST, "localhost"):
            # a page of another site, whose name was made to lead here
            self._answer(HTTPStatus.FORBIDDEN)
        elif address.path == "/":
            self._answer(HTTPStatus.OK, frame.page(None), "text/html; charset=utf-8")
        elif address.path == "/state":
            count, viewed = self.server.watch.look()
            if viewed is None or parse_qs(address.query).get("seen") == [str(count)]:
                self._answer(HTTPStatus.NO_CONTENT)
            else:
                body = frame.payload(viewed)
                self._answer(HTTPStatus.OK, body, "application/json", str(count))
        else:
            self._answer(HTTPStatus.NOT_FOUND)

    def _answer(
        self, status: HTTPStatus, body: str = "", kind: str = "text/plain", tag: str = ""
    ) -> None:
        progress, data = self.server.watch.progress, body.encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.send_header(
            "X-Status",
            "starting" if progress is None else f"running: {_words(progress)}",
        )
        if tag:
            self.send_header("ETag", tag)
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: str) -> None:
        """Say nothing: the terminal is the run's."""
