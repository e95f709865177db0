"""Export of networks as ONNX, which other programs run."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from serp.errors import needs_extra
from serp.learning import kernels
from serp.learning.network import QNetwork
from serp.learning.reflection import Reflection

_OPSET: Final = 17
"""The first with LayerNormalization."""
_IR_VERSION: Final = 8
"""The version of the format that belongs to it, which older onnxruntimes read, too."""


def network_as_onnx(network: QNetwork, reflection: Reflection | None = None) -> bytes:
    """Return a network as ONNX: `x` float32 ``[F]`` → `q` float32 ``[A]``.

    Q is the mean over members and mirror images, as of `DQN.q_values`. Both agree to float32
    accuracy: sums are added in another order.

    Raises:
        MissingExtra: onnx is not installed.
    """
    with needs_extra("export", "the export of a network"):
        import onnx
    writer = _OnnxWriter(network, reflection)
    graph = writer.graph()
    model = onnx.helper.make_model(
        graph,
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="serp",
    )
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


class _OnnxWriter:
    """Writes the nodes of one network of E members; K is 2 with mirror images, else 1."""

    def __init__(self, network: QNetwork, reflection: Reflection | None) -> None:
        self._network = network
        same = Reflection(
            range(network.sizes[0]), [1.0] * network.sizes[0], range(network.sizes[-1])
        )
        self._images = [same, *([reflection] if reflection else [])]
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def graph(self) -> Any:
        import onnx

        sizes = self._network.sizes
        columns = self._constant("columns", np.array([each.columns for each in self._images]))
        signs = self._constant("signs", np.array([each.signs for each in self._images]))
        h = self._node("Mul", self._node("Gather", "x", columns), signs)  # [K, F]
        for k in range(len(self._network.layers)):
            h = self._layer(k, h)  # [E, K, outputs]
        actions = np.array([[each.actions for each in self._images]] * self._network.members)
        of_images = self._node("GatherElements", h, self._constant("actions", actions), axis=2)
        self._node("ReduceMean", of_images, axes=[0, 1], keepdims=0, output="q")
        return onnx.helper.make_graph(
            self._nodes,
            "learner",
            [onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [sizes[0]])],
            [onnx.helper.make_tensor_value_info("q", onnx.TensorProto.FLOAT, [sizes[-1]])],
            self._constants,
        )

    def _layer(self, k: int, below: str) -> str:
        layer = self._network.layers[k]
        flat = self._network.parameters
        weight = flat[:, layer.start : layer.bias].reshape(-1, layer.inputs, layer.outputs)
        vectors = flat[:, layer.bias : layer.end].reshape(len(flat), -1, 1, layer.outputs)
        z = self._node("MatMul", below, self._constant(f"weight{k}", weight))
        z = self._node("Add", z, self._constant(f"bias{k}", vectors[:, 0]))
        if layer.normalized:
            ones = self._constant(f"ones{k}", np.ones(layer.outputs, np.float32))
            z = self._node("LayerNormalization", z, ones, epsilon=kernels.NORM_EPSILON)
            z = self._node("Mul", z, self._constant(f"gain{k}", vectors[:, 1]))
            z = self._node("Add", z, self._constant(f"shift{k}", vectors[:, 2]))
        if k == len(self._network.layers) - 1:
            return z
        return self._node("Relu", z)

    def _node(self, kind: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        import onnx

        name = output or f"n{len(self._nodes)}"
        self._nodes.append(onnx.helper.make_node(kind, inputs, [name], **attributes))
        return name

    def _constant(self, name: str, array: npt.NDArray[Any]) -> str:
        import onnx

        self._constants.append(onnx.numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name
