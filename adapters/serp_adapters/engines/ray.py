"""The engine `ray`: trials as tasks of a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

from serp.comparison.workers import Pool
from serp.errors import MissingExtra, RunError

if find_spec("ray") is None:
    raise MissingExtra("the engine `ray`", "ray")


@contextmanager
def engine(address: str | None, most: int | None) -> Iterator[Pool]:
    """Run trials on a Ray cluster, one on each of its CPUs.

    Without an address it is the cluster that this process is connected to, else that of
    `RAY_ADDRESS`, else one on this machine, which ends with the comparison. The driver reports no
    usage and starts no dashboard.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    own = not ray.is_initialized()
    if own:
        quiet = {"log_to_driver": False, "configure_logging": False}
        there = address or os.environ.get("RAY_ADDRESS")
        here = {"num_cpus": most, "include_dashboard": False} if there is None else {}
        try:
            ray.init(address=there or "local", **quiet, **here)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise RunError(f"engine ray: there is no cluster {there or 'here'}: {error}") from error
    try:
        cpus = int(ray.cluster_resources().get("CPU", 1))
        if cpus == 0:
            raise RunError("engine ray: the cluster has no CPU yet; start its workers first")
        yield Pool(_RayExecutor(ray), most or cpus)
    finally:
        if own:
            ray.shutdown()


class _RayExecutor(Executor):
    """Ray's tasks as an executor; a task whose worker is lost is not retried by Ray."""

    def __init__(self, ray: Any) -> None:
        self._remote = ray.remote(num_cpus=1, max_retries=0)(_call)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = self._remote.remote(function, args, kwargs).future()
        return future


def _call(function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    return function(*args, **kwargs)
