"""The engine `dask`: trials as tasks of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec

from serp._util.processes import safe_path
from serp.errors import MissingExtra, RunError
from serp.runs.comparison.workers import Pool

if find_spec("distributed") is None:
    raise MissingExtra("the engine `dask`", "dask")


@contextmanager
def engine(address: str | None, most: int | None) -> Iterator[Pool]:
    """Run trials on a Dask cluster, one in each of its threads.

    Without an address it is a cluster of processes on this machine, which ends with the comparison.
    """
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        stack.enter_context(safe_path())  # a worker that dies is begun again at any time
        try:
            there = address or stack.enter_context(
                LocalCluster(n_workers=most, threads_per_worker=1, dashboard_address=None)
            )
            client = stack.enter_context(Client(there))
        except (OSError, ValueError) as error:
            raise RunError(
                f"engine dask: there is no cluster {address or 'here'}: {error}"
            ) from error
        slots = sum(client.nthreads().values())
        if slots == 0:
            raise RunError("engine dask: the cluster has no workers yet; start them first")
        yield Pool(client.get_executor(), most or slots)
