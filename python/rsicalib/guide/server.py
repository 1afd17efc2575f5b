"""The page of a session: one file, which asks for the state again and again.

On the loopback address it answers to this machine alone. On another address whoever asks must have
the token of the session, which is part of the page's address. Each answer is a connection of its
own: however many pages are open, none holds one that another needs.
"""

from __future__ import annotations

import errno
import json
import secrets
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from rsicalib.errors import InputError

HOST = "127.0.0.1"
LOCAL = (HOST, "localhost", "::1")
"""Addresses of this machine alone."""


class Server(ThreadingHTTPServer):
    """A thread for each connection; one that the other side ends is no error."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing is printed of a page that was closed."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


def _reached(host: str) -> str:
    """The address under which others reach this machine, where it answers to any."""
    if host not in ("0.0.0.0", "::", ""):
        return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # of an example network: nothing is sent
            return str(probe.getsockname()[0])
        except OSError:
            return HOST


class Page:
    """Serves the page, and tells it the state of the session; `acts` are what its buttons do."""

    def __init__(
        self,
        state: Callable[[], dict[str, Any]],
        acts: Mapping[str, Callable[[], None]],
        port: int = 0,
        host: str = HOST,
    ) -> None:
        page = files("rsicalib.guide").joinpath("page.html").read_bytes()
        self._host = host
        self._token = "" if host in LOCAL else secrets.token_urlsafe(12)
        root = f"/{self._token}/" if self._token else "/"

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                if not self._ours():
                    return
                if self.path == root:
                    # What the session is like at first stands in the page; events follow.
                    first = json.dumps(state()).replace("<", "\\u003c").encode()
                    whole = page.replace(b"/* the state at first */", first)
                    self._send(200, "text/html; charset=utf-8", whole)
                elif self.path == f"{root}state":
                    self._send(200, "application/json", json.dumps(state()).encode())
                else:
                    self._send(404, "text/plain", b"not found")

            def do_POST(self) -> None:
                if not self._ours():
                    return
                act = acts.get(self.path.removeprefix(root))
                if act is not None and self.headers.get("X-Guide") == "1":
                    act()
                    self._send(200, "application/json", b"{}")
                else:
                    self._send(404, "text/plain", b"not found")

            def _ours(self) -> bool:
                """Refuse pages of other hosts that resolve here, and who has no token."""
                named = (self.headers.get("Host") or "").rsplit(":", 1)[0]
                if root != "/" and secrets.compare_digest(
                    self.path[: len(root)].encode(), root.encode()
                ):
                    return True
                if root == "/" and named.strip("[]") in LOCAL:
                    return True
                self._send(403, "text/plain", b"forbidden")
                return False

            def _send(self, code: int, kind: str, body: bytes) -> None:
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("Referrer-Policy", "no-referrer")
                self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: Any) -> None:
                """Nothing is printed: the terminal has its own page."""

        try:
            self._server = Server((host, port), Handler)
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or "ports are 0 to 65535"
            found = f"{host} port {port}, which cannot be used ({why})"
            option, expected = "--port", "a free port"
            if isinstance(error, socket.gaierror) or error.args[:1] == (errno.EADDRNOTAVAIL,):
                option, expected = "--host", "an address of this machine"
            raise InputError(f"{option}: found {found}, expected {expected}") from None
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Where the page is."""
        port = self._server.server_address[1]
        token = f"{self._token}/" if self._token else ""
        return f"http://{_reached(self._host)}:{port}/{token}"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
