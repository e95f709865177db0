"""The engine of Ray."""

import importlib
import pickle
import socket
import sys
from pathlib import Path

import pytest

from serp.errors import MissingExtra, RunError
from serp_adapters.engines import ray


def test_a_worker_of_ray_searches_the_folder_of_the_driver_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("wave", "mine_alone"):
        (tmp_path / f"{name}.py").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))  # as Ray does
    call = ray._sent()
    with pytest.raises((AttributeError, pickle.PicklingError)):
        pickle.dumps(call)  # so Ray sends the code, and no worker imports this package for it
    files = [
        call(pickle.dumps((importlib.import_module, (name,), {})), str(tmp_path)).__file__
        for name in ("wave", "mine_alone")
    ]
    assert [Path(file).parent == tmp_path for file in files] == [False, True]


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the engine is looked up, before anything is written."""
    with monkeypatch.context() as patch, pytest.raises(MissingExtra, match="the engine"):
        patch.setitem(sys.modules, "ray", None)
        importlib.reload(ray)


def test_a_cluster_that_is_not_there_is_an_error() -> None:
    pytest.importorskip("ray")  # which would try again for minutes
    with socket.create_server(("127.0.0.1", 0)) as server:
        free = server.getsockname()[1]
    for address in (f"127.0.0.1:{free}", f"ray://localhost:{free}", "nowhere.invalid:6379"):
        with pytest.raises(RunError, match=f"engine ray: there is no cluster {address}: "):
            ray.engine(address, None).__enter__()
