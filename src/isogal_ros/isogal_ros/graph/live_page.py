"""The page of a run that goes on, served to this machine: the page of `isogal view`, which asks
for new numbers each second."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from isogal.errors import InputError
from isogal_ros.graph.watching import Watch

HOST = "127.0.0.1"
"""Nobody else can connect."""
_NAMES = (HOST, "localhost")


@contextmanager
def serve(watch: Watch, port: int = 0) -> Iterator[str]:
    """Serve the page as long as the block lasts; yield its address.

    Raises
    ------
    InputError
        The port is not free, or Bokeh is not installed.
    """
    frame = watch.frame()
    try:
        server = ThreadingHTTPServer((HOST, port), _handler(watch, frame))
    except OSError as error:
        raise InputError(f"--port: {port}: {error.strerror}") from None
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def _handler(watch: Watch, frame: Any) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """Answers ``/``, the page, and ``/state``, its numbers."""

        def do_GET(self) -> None:
            """Answer one request."""
            address = urlsplit(self.path)
            if self.headers.get("Host", "").rpartition(":")[0] not in _NAMES:
                # a page of another site, whose name was made to lead here
                self._answer(HTTPStatus.FORBIDDEN, b"", "text/plain")
            elif address.path == "/":
                self._answer(HTTPStatus.OK, frame.page(None).encode(), "text/html; charset=utf-8")
            elif address.path == "/state":
                self._state(parse_qs(address.query).get("seen", [""])[0])
            else:
                self._answer(HTTPStatus.NOT_FOUND, b"", "text/plain")

        def _state(self, seen: str) -> None:
            count, viewed = watch.look()
            if viewed is None or seen == str(count):
                self._answer(HTTPStatus.NO_CONTENT, b"", "application/json")
            else:
                body = frame.payload(viewed).encode()
                self._answer(HTTPStatus.OK, body, "application/json", str(count))

        def _answer(self, status: HTTPStatus, body: bytes, kind: str, tag: str = "") -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Status", _status(watch))
            if tag:
                self.send_header("ETag", tag)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """Say nothing: the terminal is the run's."""

    return Handler


def _status(watch: Watch) -> str:
    progress = watch.progress
    if progress is None:
        return "starting"
    share = 100.0 * progress.simulated / progress.duration
    return f"running: {share:.0f} %, {progress.speed:.0f} x real time"
