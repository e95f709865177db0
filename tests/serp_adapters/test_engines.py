"""The engine of Ray."""

import importlib
import socket
import sys

import pytest

from serp.errors import MissingExtra, RunError
from serp_adapters.engines import ray


def test_what_is_missing_is_named(monkeypatch):
    """When the engine is looked up, before anything is written."""
    with monkeypatch.context() as patch, pytest.raises(MissingExtra, match="the engine"):
        patch.setitem(sys.modules, "ray", None)
        importlib.reload(ray)


def test_a_cluster_that_is_not_there_is_an_error():
    pytest.importorskip("ray")  # which would try again for minutes
    with socket.create_server(("127.0.0.1", 0)) as server:
        free = server.getsockname()[1]
    for address in (f"127.0.0.1:{free}", f"ray://localhost:{free}"):
        with pytest.raises(RunError, match=f"engine ray: there is no cluster {address}: "):
            ray.engine(address, None).__enter__()
