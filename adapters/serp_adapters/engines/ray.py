"""The engine `ray`: trials as tasks of a Ray cluster, whose machines share the folder of --out."""

from __future__ import annotations

import os
import pickle
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, Final
from urllib.parse import urlsplit

from serp.errors import MissingExtra, RunError

if find_spec("ray") is None:
    raise MissingExtra("the engine `ray`", "ray")

_HERE: Final = "local"
"""Ray's address of a new cluster on this machine."""
_PATIENCE: Final = 10.0
"""Seconds within which the head of a cluster has to take a connection."""


@contextmanager
def engine(address: str | None, most: int | None) -> Iterator[tuple[Executor, int]]:
    """Run trials on a Ray cluster, one on each of its CPUs.

    Without an address it is the cluster that this process is connected to, else that of
    `RAY_ADDRESS`, else one on this machine, which ends with the comparison. The driver reports no
    usage and starts no dashboard.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray's attempts to reach a head, each of 40 s: a wrong address fails soon.
    os.environ.setdefault("RAY_gcs_server_port_wait_time_s", "1")
    import ray

    own = not ray.is_initialized()
    if own:
        quiet = {"log_to_driver": False, "configure_logging": False}
        there = address or os.environ.get("RAY_ADDRESS") or _HERE
        here = {"num_cpus": most, "include_dashboard": False} if there == _HERE else {}
        try:
            place = urlsplit(there if "://" in there else f"//{there}")
            if place.hostname is not None and place.port is not None:  # else Ray finds it out late
                socket.create_connection((place.hostname, place.port), _PATIENCE).close()
            ray.init(address=there, **quiet, **here)
        except (OSError, RuntimeError, ValueError) as error:
            raise RunError(f"engine ray: there is no cluster {there}: {error}") from error
    try:
        cpus = int(ray.cluster_resources().get("CPU", 1))
        if cpus == 0:
            raise RunError("engine ray: the cluster has no CPU yet; start its workers first")
        yield _RayExecutor(ray), most or cpus
    finally:
        if own:
            ray.shutdown()


class _RayExecutor(Executor):
    """Ray's tasks as an executor; a task whose worker is lost is not retried by Ray."""

    def __init__(self, ray: Any) -> None:
        self._remote = ray.remote(num_cpus=1, max_retries=0)(_sent())
        self._searched_last = os.getcwd()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        call = pickle.dumps((function, args, kwargs))
        future: Future[Any] = self._remote.remote(call, self._searched_last).future()
        return future


def _sent() -> Callable[[bytes, str], Any]:
    """Return the function that a worker calls.

    Ray lets workers search the folder in which the driver runs for modules first: a file
    `gymnasium.py` there would be run in place of what is installed. They search it last instead, as
    the driver does. A function inside another one is sent whole, so that nothing is imported
    before.
    """

    def call(sent: bytes, searched_last: str) -> Any:
        import pickle
        import sys

        if searched_last in sys.path:
            sys.path[:] = [p for p in sys.path if p != searched_last] + [searched_last]
        function, args, kwargs = pickle.loads(sent)
        return function(*args, **kwargs)

    return call
