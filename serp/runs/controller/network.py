"""The learner's network, run by onnxruntime."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .folder import ControllerError

INPUT, OUTPUT = "x", "q"


class Network:
    """The values of all actions for one input.

    Args:
        model: The network as ONNX: `x` float32 `[inputs]` → `q` float32 `[actions]`.
        inputs: Length of an input.
        actions: Number of actions.
    """

    def __init__(self, model: bytes, inputs: int, actions: int) -> None:
        try:
            import onnxruntime
        except ModuleNotFoundError:
            raise ControllerError(
                "the controller needs onnxruntime: pip install onnxruntime"
            ) from None
        options = onnxruntime.SessionOptions()
        # A network of this size takes microseconds; more threads only cost their start.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session: Any = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise ControllerError(f"the learner's network cannot be read: {error}") from None
        found = [(each.name, list(each.shape)) for each in self._session.get_inputs()]
        given = [(each.name, list(each.shape)) for each in self._session.get_outputs()]
        if found != [(INPUT, [inputs])] or given != [(OUTPUT, [actions])]:
            raise ControllerError(
                f"the learner's network maps {found} to {given}, not {inputs} numbers to {actions}"
            )

    def values(self, x: NDArray[Any]) -> NDArray[np.float32]:
        """Return Q `[E]` of an input."""
        q: NDArray[np.float32] = self._session.run((OUTPUT,), {INPUT: x.astype(np.float32)})[0]
        return q

    def best(self, x: NDArray[Any]) -> int:
        """Return the first action with the largest value; NaN is less than any number."""
        q = self.values(x)
        best = int(q.argmax())
        if q[best] == q[best]:
            return best
        known = np.flatnonzero(q == q)
        return int(known[q[known].argmax()]) if len(known) else best
