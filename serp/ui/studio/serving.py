"""Serves the studio on this machine alone."""

from __future__ import annotations

import gc
import secrets
import signal
import socket
import webbrowser
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final
from urllib.parse import parse_qs

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from serp.errors import SerpError
from serp.ui.studio.pages.page import show_page
from serp.ui.studio.session import Session

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

_POLICY: Final = (
    # The pages are templates that the browser compiles, hence the two `unsafe-` of scripts. What
    # counts here: nothing is fetched from, sent to or framed by anybody else.
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws://{host}; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
_HEADERS: Final = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
)


class Guard:
    """An ASGI application in front of another one.

    The address has a random token. Whoever calls it gets a cookie, which all other requests need,
    those of websockets included. Requests that name another host (a name that somebody lets point
    to this machine) or come from a page of another origin are refused.

    Args:
        app: What is guarded.
        port: The port of this machine at which it is served.
    """

    def __init__(self, app: Application, port: int) -> None:
        self.app = app
        self.token = secrets.token_urlsafe(32)
        self._cookie = secrets.token_urlsafe(32)
        self._cookie_name = f"serp-studio-{port}"
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._host = f"127.0.0.1:{port}"

    @property
    def address(self) -> str:
        """The address to open in a browser, with the token."""
        return f"http://{self._host}/?token={self.token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):  # start and end of the server
            await self.app(scope, receive, send)
            return
        headers = _single(scope["headers"])
        refusal = self._refusal(scope, headers)
        if refusal:
            await _refuse(scope, send, refusal)
        elif self._knows(headers):
            await self.app(scope, receive, self._marked(send, headers["host"]))
        elif self._has_token(scope):
            await self._welcome(send)
        else:
            await _refuse(scope, send, "open the address that serp studio has printed")

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> str:
        """Return why a request is refused whatever it knows; empty where it is not."""
        host = headers.get("host", "")
        if host not in self._hosts:
            return "this is not the name of this server"
        origin = headers.get("origin")
        if origin is None and scope["type"] == "websocket":
            return "no origin is given"
        if origin is not None and origin != f"http://{host}":
            return "requests of other pages are refused"
        return ""

    def _knows(self, headers: dict[str, str]) -> bool:
        for cookie in headers.get("cookie", "").split(";"):
            name, _, value = cookie.strip().partition("=")
            if name == self._cookie_name and _equal(value, self._cookie):
                return True
        return False

    def _has_token(self, scope: Scope) -> bool:
        if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != "/":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])
        return _equal(given[0], self.token)

    async def _welcome(self, send: Send) -> None:
        """Set the cookie, and let the browser call again, without the token in the address.

        It is the page that calls again: a redirection that began at another site would come
        without the cookie.
        """
        cookie = f"{self._cookie_name}={self._cookie}; HttpOnly; SameSite=Strict; Path=/"
        page = b'<!doctype html><meta http-equiv="refresh" content="0;url=/"><title>serp</title>'
        headers = [
            (b"content-type", b"text/html; charset=utf-8"),
            (b"cache-control", b"no-store"),
            (b"set-cookie", cookie.encode()),
            *_HEADERS,
        ]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": page})

    def _marked(self, send: Send, host: str) -> Send:
        """Return a `send` that adds the headers that keep a page to itself."""
        added = [*_HEADERS, (b"content-security-policy", _POLICY.format(host=host).encode())]

        async def marked(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *added]
            await send(message)

        return marked


async def _refuse(scope: Scope, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *_HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"Refused: {why}.\n".encode()})


def _single(headers: list[tuple[bytes, bytes]]) -> dict[str, str]:
    """Return headers by name; one that is given twice is none that is known."""
    found: dict[str, str] = {}
    for key, value in headers:
        name = key.decode("latin-1").lower()
        known = found.get(name)
        text = value.decode("latin-1")
        # HTTP/2 may split cookies; every other header here is given once.
        found[name] = text if known is None else f"{known}; {text}"
    return found


def _equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())


_LOOPBACK = "127.0.0.1"


def serve(
    session: Session,
    port: int,
    *,
    browser: bool,
    said: Callable[[str], None],
    warned: Callable[[str], None],
) -> None:
    """Serve the studio until the process is interrupted.

    Args:
        session: What is open.
        port: Port; 0 for any that is free.
        browser: Whether to open a browser.
        said: Called with the address as soon as it can be called.
        warned: Called at the end with what was not saved.

    Raises:
        SerpError: The port is taken.
    """
    with _listening(port) as listening:
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        ui.run_with(
            app,
            root=lambda: show_page(session),
            title=f"{session.documents['domain'].path.name} – serp studio",
            dark=None,
            show_welcome_message=False,
            reconnect_timeout=10.0,
        )
        guard = Guard(app, listening.getsockname()[1])
        config = uvicorn.Config(
            guard,
            lifespan="on",
            log_level="critical",  # browsers that leave in mid-answer are no error
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
        said(guard.address)
        if browser:
            webbrowser.open(guard.address)
        gc.collect()
        gc.freeze()  # what was imported: passing over it took longer than a whole view
        server = uvicorn.Server(config)
        _end_at_signals(server)
        try:
            server.run(sockets=[listening])
        finally:
            for each in session.close():
                warned(each)


def _end_at_signals(server: uvicorn.Server) -> None:
    """Let a closed terminal and SIGTERM end the server, so that what was not saved is kept."""
    for name in ("SIGHUP", "SIGTERM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda *_: setattr(server, "should_exit", True))


def _listening(port: int) -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((_LOOPBACK, port))
        found.listen()  # who calls before the server is ready waits
    except OSError as error:
        found.close()
        raise SerpError(
            f"port {port} cannot be used ({error.strerror}); give another one, or --port 0 for any "
            "that is free"
        ) from error
    return found
