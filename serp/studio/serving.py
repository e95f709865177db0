"""Serves the studio on this machine alone."""

from __future__ import annotations

import gc
import signal
import socket
import webbrowser
from collections.abc import Callable

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from serp.errors import SerpError
from serp.studio.guard import Guard
from serp.studio.pages.page import show_page
from serp.studio.session import Session

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
