"""The page of a session, on the loopback address only: one file, and server-sent events."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from rsicalib.errors import InputError

__all__ = ["Page"]

HOST = "127.0.0.1"
EVERY_S = 0.1
"""Between two events while nothing changes, at the most ten times as long."""


class Page:
    """Serves the page, and tells it the state of the session."""

    def __init__(
        self, state: Callable[[], dict[str, Any]], strike_off: Callable[[], None], port: int = 0
    ) -> None:
        page = files("rsicalib.guide").joinpath("page.html").read_bytes()
        stop = threading.Event()

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                if not self._ours():
                    return
                if self.path == "/":
                    # What the session is like at first stands in the page; events follow.
                    first = json.dumps(state()).replace("<", "\\u003c").encode()
                    whole = page.replace(b"/* the state at first */", first)
                    self._send(200, "text/html; charset=utf-8", whole)
                elif self.path == "/state":
                    self._send(200, "application/json", json.dumps(state()).encode())
                elif self.path == "/events":
                    self._events()
                else:
                    self._send(404, "text/plain", b"not found")

            def do_POST(self) -> None:
                if not self._ours():
                    return
                if self.path == "/strike-off" and self.headers.get("X-Guide") == "1":
                    strike_off()
                    self._send(200, "application/json", b"{}")
                else:
                    self._send(404, "text/plain", b"not found")

            def _ours(self) -> bool:
                """Refuse pages of other hosts that resolve to this address."""
                host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
                if host in (HOST, "localhost"):
                    return True
                self._send(403, "text/plain", b"forbidden")
                return False

            def _send(self, code: int, kind: str, body: bytes) -> None:
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
                self.end_headers()
                self.wfile.write(body)

            def _events(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "text/event-stream")
                self.send_header("Cache-Control", "no-store")
                self.send_header("Connection", "close")
                self.end_headers()
                said, silent = "", 0
                try:
                    while not stop.is_set():
                        text = json.dumps(state())
                        silent += 1
                        if text != said or silent >= 10:
                            self.wfile.write(f"data: {text}\n\n".encode())
                            self.wfile.flush()
                            said, silent = text, 0
                        stop.wait(EVERY_S)
                    # What is last shown is the end of the session.
                    self.wfile.write(f"data: {json.dumps(state())}\n\n".encode())
                except OSError:
                    pass  # the page was closed
                self.close_connection = True

            def log_message(self, format: str, *args: Any) -> None:
                """Nothing is printed: the terminal has its own page."""

        try:
            self._server = ThreadingHTTPServer((HOST, port), Handler)
        except OSError as error:
            found = f"{port}, which cannot be used ({error.strerror})"
            raise InputError(f"--port: found {found}, expected a free port") from None
        self._server.daemon_threads = True
        self._stop = stop
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self._server.server_address[1]}/"

    def close(self) -> None:
        """Stop serving."""
        self._stop.set()
        self._server.shutdown()
        self._server.server_close()
