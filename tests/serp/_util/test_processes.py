"""The number of threads: what is computed does not depend on when a library is loaded."""

import json
import subprocess
import sys

import pytest


@pytest.mark.parametrize("limit", ["one_thread", "blas_on_one_thread"])
def test_a_library_that_is_used_later_has_one_thread_too(limit):
    script = f"""
import json, numpy, threadpoolctl
from serp._util.processes import {limit}
with {limit}():
    import scipy.linalg
    print(json.dumps([each["num_threads"] for each in threadpoolctl.threadpool_info()]))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert set(json.loads(done.stdout)) == {1}
