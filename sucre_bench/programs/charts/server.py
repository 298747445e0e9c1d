"""Serves the page for marking charts to a browser on this machine only.

The server listens on 127.0.0.1. Every address holds a random token, and requests must name this host, so that no other
open page can send any. The page loads nothing from elsewhere, and its content policy forbids it.
"""

import json
import re
import secrets
import sys
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError, one_line
from sucre_bench.programs.charts.session import Session

_FILES = {
    "": ("page.html", "text/html"),
    "page.js": ("page.js", "text/javascript"),
    "page.css": ("page.css", "text/css"),
}
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'"
_MOST_BYTES = 1 << 20  # bytes of a request: a thousand charts


class PageServer(ThreadingHTTPServer):
    """Serves one session at `url`. `serve_forever` runs until the page ends it or `shutdown` is called."""

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as fault:
            raise InputError(
                f"--port {port}: {fault.strerror}; give another, or 0 for any that is free"
            ) from fault
        self.session = session
        self.token = secrets.token_urlsafe(16)

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://127.0.0.1:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that closed its connection, or sends nothing more; print other errors."""
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    timeout = 60.0  # seconds that a connection may be silent

    def do_GET(self) -> None:
        path, query = self._asked()
        session = self.server.session
        if path is None:
            self._say(403, "not for you; open the address that was printed")
        elif path in _FILES:
            name, kind = _FILES[path]
            self._reply(
                200, f"{kind}; charset=utf-8", Path(__file__).with_name(name).read_bytes()
            )
        elif path == "state":
            self._answer(session.state)
        elif path == "image":
            self._answer(lambda: session.image(int(query["view"]), query.get("bright") == "1"))
        else:
            self._say(404, "no such page")

    def do_POST(self) -> None:
        path, _ = self._asked()
        session = self.server.session
        origin = self.headers.get("Origin")
        length = self.headers.get("Content-Length", "")
        is_short = re.fullmatch("[0-9]{1,7}", length) and int(length) <= _MOST_BYTES
        if path is None or origin not in (None, *(f"http://{host}" for host in self._hosts())):
            self._say(403, "not for you; open the address that was printed")
        elif not is_short or self.headers.get_content_type() != "application/json":
            self._say(400, "expected JSON")
        elif path in ("check", "save"):
            body = self.rfile.read(int(length))
            work = session.check if path == "check" else session.save
            self._answer(lambda: work(**json.loads(body)))
        elif path == "done":
            self._answer(dict)
            self.server.shutdown()
        else:
            self._say(404, "no such page")

    def _asked(self) -> tuple[str | None, dict[str, str]]:
        """The path below the token, None for a wrong token or host; and the query."""
        try:
            parts = urlsplit(self.path)
        except ValueError:  # no address at all
            return None, {}
        token, _, path = parts.path.lstrip("/").partition("/")
        ours = secrets.compare_digest(token.encode(), self.server.token.encode())
        is_here = self.headers.get("Host", "") in self._hosts()
        query = {name: values[0] for name, values in parse_qs(parts.query).items()}
        return (path if ours and is_here else None), query

    def _hosts(self) -> tuple[str, ...]:
        return tuple(f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost"))

    def _answer(self, work: Callable[[], Any]) -> None:
        """Reply with the result of `work`, bytes as an image; if it raises, with the reason."""
        try:
            result = work()
        except (KeyError, TypeError, ValueError, RecursionError):
            self._say(400, "not a request of this page; reload it")
        except SucreBenchError as fault:
            self._say(422, one_line(fault))
        except ANY_FAULT as fault:
            self._say(500, one_line(fault))
        else:
            if isinstance(result, bytes):
                self._reply(200, "image/jpeg", result)
            else:
                self._reply(200, "application/json", json.dumps(result).encode())

    def _say(self, status: int, text: str) -> None:
        self._reply(status, "text/plain; charset=utf-8", text.encode())

    def _reply(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
        }
        headers |= {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}
        for name, value in {**headers, "Content-Security-Policy": _POLICY}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print no log of requests."""
