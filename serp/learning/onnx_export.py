"""Export of networks as ONNX, which other programs run."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from serp import _core
from serp.errors import needs_extra

_OPSET, _IR_VERSION = 17, 8
"""The first with LayerNormalization, and the version of the format that belongs to it."""


def network_as_onnx(network: _core.QNetwork) -> bytes:
    """Return a network as ONNX: `x` float32 ``[F]`` → `q` float32 ``[A]``.

    Q is the mean over members, as of `QNetwork.q`, to float32 accuracy: sums are added in another
    order. Without onnx, `MissingExtra` is raised.
    """
    with needs_extra("export", "the export of a network"):
        import onnx
    nodes: list[Any] = []
    constants: list[Any] = []

    def node(kind: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        name = output or f"n{len(nodes)}"
        nodes.append(onnx.helper.make_node(kind, inputs, [name], **attributes))
        return name

    def constant(name: str, array: npt.NDArray[Any]) -> str:
        constants.append(onnx.numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    flat = network.parameters
    h = node("Unsqueeze", "x", constant("axes", np.array([0])))  # [1, F]
    for k, layer in enumerate(network.layers):  # [E, 1, outputs]
        weight = flat[:, layer.start : layer.bias].reshape(-1, layer.inputs, layer.outputs)
        vectors = flat[:, layer.bias : layer.end].reshape(len(flat), -1, 1, layer.outputs)
        h = node("MatMul", h, constant(f"weight{k}", weight))
        h = node("Add", h, constant(f"bias{k}", vectors[:, 0]))
        if layer.normalized:
            ones = constant(f"ones{k}", np.ones(layer.outputs, np.float32))
            h = node("LayerNormalization", h, ones, epsilon=_core.NORM_EPSILON)
            h = node("Mul", h, constant(f"gain{k}", vectors[:, 1]))
            h = node("Add", h, constant(f"shift{k}", vectors[:, 2]))
        if k + 1 < len(network.layers):
            h = node("Relu", h)
    node("ReduceMean", h, axes=[0, 1], keepdims=0, output="q")

    def numbers(name: str, count: int) -> Any:
        return onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [count])

    model = onnx.helper.make_model(
        onnx.helper.make_graph(
            nodes, "learner", [numbers("x", network.sizes[0])], [numbers("q", network.sizes[-1])],
            constants,
        ),
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)], ir_version=_IR_VERSION,
        producer_name="serp",
    )  # fmt: skip
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content
