"""Serves the page for marking charts to a browser on this machine only.

The server listens on 127.0.0.1. Every address holds a random token, and requests must name this host, so that no other
open page can send any. The page loads nothing from elsewhere, and its content policy forbids it.
"""

import importlib.resources
import json
import re
import secrets
import sys
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError, one_line
from sucre_bench.programs.charts.session import Session

_FILES = {
    "": ("page.html", "text/html"),
    "page.js": ("page.js", "text/javascript"),
    "page.css": ("page.css", "text/css"),
}
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:"
_MOST_BYTES = 1 << 20  # bytes of a request: a thousand charts


class PageServer(ThreadingHTTPServer):
    """Serves one session at `url`. `serve_forever` runs until the page ends it or `shutdown` is called."""

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as fault:
            raise InputError(f"--port {port}: {fault.strerror}; give another, or 0 for any that is free") from fault
        self.session, self.token = session, secrets.token_urlsafe(16)

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
            self._refuse()
        elif path in _FILES:
            name, kind = _FILES[path]
            content = importlib.resources.files("sucre_bench.programs.charts").joinpath(name).read_bytes()
            self._reply(200, f"{kind}; charset=utf-8", content)
        elif path == "state":
            self._answer(session.state)
        elif path == "image":
            self._answer(lambda: session.image(int(query["view"]), query.get("bright") == "1"))
        else:
            self._reply(404, "text/plain; charset=utf-8", b"no such page")

    def do_POST(self) -> None:
        path, _ = self._asked()
        session, origin = self.server.session, self.headers.get("Origin")
        if path is None or origin not in (None, *(f"http://{host}" for host in self._hosts())):
            self._refuse()
            return
        length = self.headers.get("Content-Length", "")
        if (
            not re.fullmatch("[0-9]{1,7}", length)
            or int(length) > _MOST_BYTES
            or self.headers.get_content_type() != "application/json"
        ):
            self._reply(400, "text/plain; charset=utf-8", b"expected JSON")
            return
        body = self.rfile.read(int(length))
        if path == "check":
            self._answer(lambda: session.check(**_arguments(body, "number", "kind", "corners")))
        elif path == "save":
            self._answer(lambda: session.save(**_arguments(body, "number", "charts", "turned_down")))
        elif path == "done":
            self._answer(dict)
            self.server.shutdown()
        else:
            self._reply(404, "text/plain; charset=utf-8", b"no such page")

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
        except (KeyError, TypeError, ValueError):
            self._reply(400, "text/plain; charset=utf-8", b"not a request of this page; reload it")
        except SucreBenchError as fault:
            self._reply(422, "text/plain; charset=utf-8", one_line(fault).encode())
        except ANY_FAULT as fault:
            self._reply(500, "text/plain; charset=utf-8", one_line(fault).encode())
        else:
            if isinstance(result, bytes):
                self._reply(200, "image/jpeg", result)
            else:
                self._reply(200, "application/json", json.dumps(result).encode())

    def _refuse(self) -> None:
        self._reply(403, "text/plain; charset=utf-8", b"not for you; open the address that was printed")

    def _reply(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        headers = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store"}
        headers |= {"Content-Security-Policy": _POLICY, "X-Content-Type-Options": "nosniff"}
        for name, value in {**headers, "Referrer-Policy": "no-referrer"}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print no log of requests."""


def _arguments(body: bytes, *names: str) -> dict[str, Any]:
    """The named values of a JSON object. Raises ValueError for anything else."""
    try:
        values = json.loads(body)
    except RecursionError as fault:
        raise ValueError("nested too deeply") from fault
    if not isinstance(values, dict) or set(values) - set(names):
        raise ValueError("not a request")
    return values
