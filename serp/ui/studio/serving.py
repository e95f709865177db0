"""Serves the studio on this machine alone."""

from __future__ import annotations

import contextlib
import gc
import secrets
import signal
import socket
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Final

import uvicorn
from fastapi import FastAPI
from nicegui import ui
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from serp._util.files import write_durably
from serp.errors import SerpError
from serp.ui.output import print_result
from serp.ui.root import say
from serp.ui.studio.pages.page import show_page
from serp.ui.studio.session import Session

_POLICY: Final = (
    # The pages are templates that the browser compiles, hence the two `unsafe-` of scripts. What
    # counts here: nothing is fetched from, sent to or framed by anybody else.
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws://{host}; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
_HEADERS: Final = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}


class Guard:
    """An ASGI application in front of another one, at a port of this machine.

    The address has a random token, which is good for one call; `on_used` is called when there is
    another one. Who calls it gets a cookie and is sent to a secret path, below which everything
    lies. All other requests need both, those of websockets included: a browser sends cookies to
    every port of this machine, but only for their path. Requests that name another host (a name
    that somebody lets point to this machine) or come from a page of another origin are refused.
    """

    def __init__(self, app: ASGIApp, port: int, on_used: Callable[[], None] = lambda: None) -> None:
        self.app = app
        self._on_used = on_used
        self.token, self._cookie = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self._path = f"/{secrets.token_urlsafe(32)}"
        self._cookie_name, self._port = f"serp-studio-{port}", port
        self._hosts = (f"127.0.0.1:{port}", f"localhost:{port}")

    @property
    def address(self) -> str:
        """The address with the token that is good now."""
        return f"http://127.0.0.1:{self._port}/?token={self.token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):  # start and end of the server
            await self.app(scope, receive, send)
            return
        request, page = HTTPConnection(scope), scope["type"] == "http"
        hosts, origins = (request.headers.getlist(name) for name in ("host", "origin"))
        own = len(hosts) == 1 and hosts[0] in self._hosts
        own = own and origins in ([f"http://{hosts[0]}"], *([[]] if page else []))
        # The page that hands the token over may be of any origin.
        near = request.headers.get("sec-fetch-site", "none") in ("same-origin", "none")
        below = _equal(scope["path"][: len(self._path) + 1], f"{self._path}/")
        known = below and _equal(request.cookies.get(self._cookie_name, ""), self._cookie)
        if own and near and known:
            scope = {**scope, "root_path": self._path}
            await self.app(scope, receive, _private(send, hosts[0]))
        elif own and page and scope["path"] == "/" and self._has_token(request):
            # The page calls again, without the token in the address: a redirection that began at
            # another site would come without the cookie.
            self.token = secrets.token_urlsafe(32)
            headers = {**_HEADERS, "cache-control": "no-store"}
            welcome = HTMLResponse(_leading_to(f"{self._path}/"), headers=headers)
            welcome.set_cookie(
                self._cookie_name, self._cookie, path=self._path, httponly=True, samesite="strict"
            )
            await welcome(scope, receive, send)
            self._on_used()
        elif page:
            refusal = "Refused: open the address that serp studio has printed.\n"
            await PlainTextResponse(refusal, 403, _HEADERS)(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1008})

    def _has_token(self, request: HTTPConnection) -> bool:
        given = request.query_params.get("token", "")
        return request.scope["method"] == "GET" and _equal(given, self.token)


def _leading_to(address: str) -> str:
    """Return a page that leads to another one."""
    return (
        f'<!doctype html><meta http-equiv="refresh" content="0;url={address}">'
        '<meta name="referrer" content="no-referrer"><title>serp studio</title>'
    )


def _private(send: Send, host: str) -> Send:
    """Return a `send` that adds the headers that keep a page to itself."""

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.update({**_HEADERS, "content-security-policy": _POLICY.format(host=host)})
        await send(message)

    return sent


def _equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())


def serve(session: Session, port: int, *, browser: bool) -> None:
    """Serve the studio until it is interrupted; print its address, and what is not saved."""
    try:
        listening = socket.create_server(("127.0.0.1", port))  # who calls at once waits
    except OSError as error:
        raise SerpError(
            f"port {port} cannot be used ({error.strerror}); give another one, or --port 0 for any "
            "that is free"
        ) from error
    with listening, contextlib.ExitStack() as stack:
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        ui.run_with(
            app,
            root=lambda: show_page(session),
            title=f"{session.documents['domain'].path.name} – serp studio",
            dark=None,
            show_welcome_message=False,
            reconnect_timeout=10.0,
        )
        private = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="serp-studio-")))
        opening = private / "open.html"  # a browser's arguments are seen by every user

        def hand_over() -> None:
            """Show the address, by a file for this user's browser, too."""
            write_durably(opening, _leading_to(guard.address))
            print_result(guard.address)

        guard = Guard(app, listening.getsockname()[1], hand_over)
        config = uvicorn.Config(
            guard,
            lifespan="on",
            log_level="critical",  # browsers that leave in mid-answer are no error
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
        hand_over()
        if browser:
            webbrowser.open(opening.as_uri())
        gc.collect()
        gc.freeze()  # what was imported: passing over it takes longer than a whole view
        server = uvicorn.Server(config)
        for name in ("SIGHUP", "SIGTERM"):  # a closed terminal keeps what was not saved, too
            if hasattr(signal, name):
                signal.signal(
                    getattr(signal, name), lambda *_: setattr(server, "should_exit", True)
                )
        try:
            server.run(sockets=[listening])
        finally:
            for message in session.close():
                say(message)
