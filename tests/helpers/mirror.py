"""A mirror of GGMplus on this machine, with the faults that servers have."""

import socket
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Mirror(ThreadingHTTPServer):
    """Serves ``files``; each request to a path first takes the next entry of its ``trouble``."""

    daemon_threads = True

    def __init__(self, files: dict[str, bytes]) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.files = files
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
        name, asked = self.path.rpartition("/")[2], self.headers.get("Range")
        self.server.requests.append((self.path, asked))
        what = self.server.trouble[name].pop(0) if self.server.trouble[name] else "good"
        body = self.server.files.get(name)
        if isinstance(what, int) or body is None:
            self.send_error(what if isinstance(what, int) else 404)
            return
        if what == "slow":
            time.sleep(1.0)
        start = 0
        if asked and what != "no resume":
            start = int(asked.removeprefix("bytes=").rstrip("-"))
            if start >= len(body):
                self.send_error(416)
                return
        start = 7 if what == "lies" else start
        self.send_response(206 if start else 200)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(body) - 1}/{len(body)}")
        rest = body[start:-100] if what == "shorter" else body[start:]
        if what == "no length":
            rest += b"surplus"
        else:
            self.send_header("Content-Length", str(len(rest)))
        self.end_headers()
        sent = {"cut": len(rest) // 2, "stall": 1000}.get(what, len(rest))
        self.wfile.write(rest[:sent])
        self.wfile.flush()
        if what == "cut":
            self.connection.shutdown(socket.SHUT_RDWR)
        elif what == "stall":
            time.sleep(1.0)


@contextmanager
def serving(files: dict[str, bytes]) -> Iterator[Mirror]:
    """Serve files meanwhile."""
    server = Mirror(files)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()
