"""The server: one page, its scene and its news, to this machine alone."""

from __future__ import annotations

import secrets
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Semaphore, Thread
from typing import TYPE_CHECKING

from showc.view.page import render_scene

if TYPE_CHECKING:
    from showc.preview.session import Session

ADDRESS = "127.0.0.1"
"""Where it listens: other machines cannot reach it."""
_BEAT = 10.0
"""Time after which a page without news is sent a sign of life [s]."""
_MOST_LISTENERS = 16
"""Pages that hear news at a time."""
_TIMEOUT = 30.0
"""Longest time that a request may take to arrive [s]."""


class Server(ThreadingHTTPServer):
    """Answers pages on this machine.

    Requests must name this server as their host: a page from elsewhere that has its own
    name lead here (DNS rebinding) gets nothing. Answers allow no page of other origins
    to read them, and the page may load nothing from elsewhere.

    Parameters
    ----------
    session
        What to show.
    port
        To listen on; 0: one that is free.
    """

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        super().__init__((ADDRESS, port), Handler)
        self.session = session
        self.listeners = Semaphore(_MOST_LISTENERS)
        number = self.server_address[1]
        self.hosts = {f"{ADDRESS}:{number}", f"localhost:{number}"}
        self.url = f"http://{ADDRESS}:{number}/"

    def start(self) -> None:
        """Answer in threads of their own from now on."""
        Thread(target=self.serve_forever, daemon=True).start()


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: Server
    protocol_version = "HTTP/1.1"
    timeout = _TIMEOUT

    def do_GET(self) -> None:
        """Send the page, the scene, or news as they come."""
        if self.headers.get("Host") not in self.server.hosts:
            self._send(421, b"this server answers to its own address alone\n")
        elif self.headers.get("Sec-Fetch-Site", "none") not in {"none", "same-origin"}:
            self._send(403, b"this server answers its own page alone\n")
        elif self.path.partition("?")[0] == "/":
            self._page()
        elif self.path == "/scene":
            self._send(200, self.server.session.body, "application/octet-stream")
        elif self.path == "/news":
            self._news()
        else:
            self._send(404, b"there is nothing of that name\n")

    def log_message(self, *_: object) -> None:
        """Say nothing: the terminal belongs to the findings."""

    def _page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        title = self.server.session.script.name
        page = render_scene(title, {}, "", more="live", nonce=nonce)
        policy = (
            f"default-src 'none'; connect-src 'self'; script-src 'nonce-{nonce}'; "
            f"style-src 'nonce-{nonce}'; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )
        self._send(200, page.encode(), "text/html; charset=utf-8", policy)

    def _send(
        self,
        code: int,
        body: bytes,
        kind: str = "text/plain; charset=utf-8",
        policy: str = "default-src 'none'",
    ) -> None:
        self.send_response(code)
        self._heads(kind, policy)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with suppress(OSError):
            self.wfile.write(body)

    def _heads(self, kind: str, policy: str) -> None:
        for name, value in {
            "Content-Type": kind,
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.send_header(name, value)

    def _news(self) -> None:
        """Send the number of each new version, as server-sent events."""
        if not self.server.listeners.acquire(blocking=False):
            self._send(503, b"too many pages are open\n")
            return
        try:
            self.close_connection = True
            self.send_response(200)
            self._heads("text/event-stream", "default-src 'none'")
            self.end_headers()
            shown, session = -1, self.server.session
            while True:
                version = session.wait(shown, _BEAT)
                news = (
                    f"data: {version}\n\n" if version != shown else ": still here\n\n"
                )
                shown = version
                self.wfile.write(news.encode())
                self.wfile.flush()
        except OSError:
            return  # the page is closed
        finally:
            self.server.listeners.release()
