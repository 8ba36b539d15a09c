"""Headless Chromium, driven through its DevTools protocol."""

import asyncio
import json
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
PATIENCE = 60.0
"""s."""
_TOLD = {"Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"}


class Browser:
    """One page, and what it wrote to its console."""

    def __init__(self, socket: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._socket, self._loop, self._count = socket, loop, 0
        self.told: list[dict[str, Any]] = []
        """Events of the console and exceptions, but for plain information."""
        self.requests: list[str] = []
        """Addresses that were asked for."""

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the protocol."""
        return self._loop.run_until_complete(self._call(method, parameters))

    async def _call(self, method: str, parameters: dict[str, Any]) -> Any:
        self._count += 1
        await self._socket.write_message(
            json.dumps({"id": self._count, "method": method, "params": parameters})
        )
        while True:
            text = await asyncio.wait_for(self._socket.read_message(), PATIENCE)
            answer = json.loads(text)
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]
            self._take(answer)

    def _take(self, event: dict[str, Any]) -> None:
        method, values = event["method"], event["params"]
        if method == "Network.requestWillBeSent":
            self.requests.append(values["request"]["url"])
        elif method in _TOLD and values.get("type") not in ("log", "info", "debug"):
            self.told.append(event)

    def value(self, expression: str) -> Any:
        """Return the value of JavaScript."""
        result = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait until JavaScript is true."""
        end = time.monotonic() + PATIENCE
        while not self.value(expression):
            assert time.monotonic() < end, expression
            time.sleep(0.02)

    def open(self, address: str, width: int = 1200, height: int = 900) -> None:
        """Open a page in a window."""
        self.resize(width, height)
        self.call("Page.navigate", url=address)
        self.until("document.body && document.body.dataset.ready === 'true'")

    def resize(self, width: int, height: int) -> None:
        """Change the size of the window."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            **{"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
        )

    def press(self, key: str) -> None:
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Move, press, release or turn the wheel."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def click(self, x: float, y: float) -> None:
        """Click."""
        self.mouse("mouseMoved", x, y)
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y, button="left", clickCount=1)


@contextmanager
def chromium(folder: Path) -> Iterator[Browser]:
    """Start a browser with its profile in a folder."""
    assert CHROMIUM is not None
    command = [
        *(CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"),
        *("--disable-background-networking", "--remote-debugging-port=0"),
        *(f"--user-data-dir={folder}", "about:blank"),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    loop = asyncio.new_event_loop()
    try:
        address = _address(process)
        socket = loop.run_until_complete(_connect(address))
        browser = Browser(socket, loop)
        for domain in ("Runtime", "Page", "Log", "Network"):
            browser.call(f"{domain}.enable")
        yield browser
        socket.close()
    finally:
        process.terminate()
        process.wait()
        loop.close()


def _address(process: subprocess.Popen[str]) -> str:
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"ws://([^/ ]+)/", line):
            return found[1]
    raise AssertionError("chromium did not start")


async def _connect(address: str) -> Any:
    from tornado.httpclient import AsyncHTTPClient
    from tornado.websocket import websocket_connect

    answer = await AsyncHTTPClient().fetch(f"http://{address}/json")
    page = next(target for target in json.loads(answer.body) if target["type"] == "page")
    return await websocket_connect(page["webSocketDebuggerUrl"], max_message_size=2**27)
