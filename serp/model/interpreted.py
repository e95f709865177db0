"""Running a generated transition function in CPython."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from serp.model.codegen import Generated


def load_function(generated: Generated, filename: str) -> Callable[..., int]:
    """Turn a generated tree into a Python function.

    The tree is compiled as it is; there is no text in between.

    Args:
        generated: What to load.
        filename: Shown in tracebacks; compiled code is kept under it.
    """
    # numba finds the environment of a cached function through the module's name.
    namespace: dict[str, Any] = {"__builtins__": {}, "__name__": __name__}
    exec(compile(generated.tree, filename, "exec"), namespace)
    function: Callable[..., int] = namespace[generated.name]
    return function
