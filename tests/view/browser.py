"""A headless Chromium under remote control: just what the tests of pages need."""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import struct
import subprocess
import time
import urllib.request
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
)


def find_browser() -> str | None:
    """Path of a Chromium, or None."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Tab:
    """One page; speaks the DevTools protocol over a WebSocket (RFC 6455)."""

    def __init__(self, url: str) -> None:
        host, path = url.removeprefix("ws://").split("/", 1)
        name, port = host.split(":")
        self.socket = socket.create_connection((name, int(port)), timeout=60.0)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            (
                f"GET /{path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\n"
                f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
                "Sec-WebSocket-Version: 13\r\n\r\n"
            ).encode()
        )
        answer = b""
        while b"\r\n\r\n" not in answer:
            answer += self.socket.recv(1)
        self.count = 0
        self.errors: list[str] = []
        self.call("Runtime.enable")
        self.call("Page.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.count += 1
        message = json.dumps(
            {"id": self.count, "method": method, "params": parameters}
        ).encode()
        size = len(message)
        head = bytes([0x80 | size]) if size < 126 else b"\xfe" + struct.pack(">H", size)
        self.socket.sendall(b"\x81" + head + bytes(4) + message)
        while True:
            answer = json.loads(self._receive())
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(answer["params"]["exceptionDetails"]))
            if answer.get("id") == self.count:
                if "error" in answer:
                    raise RuntimeError(answer["error"])
                return answer["result"]

    def _exactly(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            part = self.socket.recv(size - len(data))
            if not part:
                raise ConnectionError("the browser has gone")
            data += part
        return bytes(data)

    def _receive(self) -> bytes:
        whole = b""
        while True:
            first, second = self._exactly(2)
            size = second & 0x7F
            if size >= 126:
                form = ">H" if size == 126 else ">Q"
                (size,) = struct.unpack(form, self._exactly(struct.calcsize(form)))
            whole += self._exactly(size)
            if first & 0x80:
                return whole

    def evaluate(self, expression: str) -> Any:
        found = self.call(
            "Runtime.evaluate",
            expression=expression,
            returnByValue=True,
            awaitPromise=True,
        )
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"])
        return found["result"].get("value")

    def open(self, page: Path, query: str = "", *, seconds: float = 60.0) -> None:
        """Load a page of ours and wait until it has drawn itself."""
        self.visit(page.as_uri() + (f"?{query}" if query else ""), seconds=seconds)

    def visit(self, page: str, *, seconds: float = 60.0) -> None:
        """Load an address and wait until its page has drawn itself."""
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=page)
        end = time.monotonic() + seconds
        # Pages without a script say so in their first line, long before their last.
        drawn = "document.readyState === 'complete' && "
        drawn += "document.documentElement.dataset.ready === 'yes'"
        while not self.evaluate(drawn):
            if time.monotonic() > end:
                raise TimeoutError(f"{page} did not draw itself in {seconds} s")
            time.sleep(0.05)

    def screenshot(self) -> bytes:
        """Return the page as a PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot")["data"])

    def printed(self) -> bytes:
        """Return the page as a PDF, as a printer would get it."""
        found = self.call("Page.printToPDF", printBackground=True)
        return base64.b64decode(found["data"])


@contextmanager
def open_browser(folder: Path, *, width: int = 1280, height: int = 800):
    """Start a browser with one empty tab."""
    command = [
        str(find_browser()),
        *FLAGS,
        f"--window-size={width},{height}",
        f"--user-data-dir={folder}",
        "about:blank",
    ]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        found = folder / "DevToolsActivePort"
        end = time.monotonic() + 60.0
        while not (found.exists() and found.read_text().count("\n")):
            if time.monotonic() > end or process.poll() is not None:
                raise TimeoutError("the browser did not start")
            time.sleep(0.05)
        port = found.read_text().split()[0]
        with urllib.request.urlopen(
            f"http://127.0.0.1:{port}/json", timeout=60
        ) as answer:
            tabs = [tab for tab in json.load(answer) if tab["type"] == "page"]
        tab = Tab(tabs[0]["webSocketDebuggerUrl"])
        tab.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        yield tab
    finally:
        process.terminate()
        try:
            process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
