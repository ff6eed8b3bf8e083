"""Bundles with a policy in ONNX, as exporters write them."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from jaxtyping import Float32
from onnx import TensorProto, helper, numpy_helper

from specs.data.episode import ApplicationLaunch
from tests.repository import ROOT

RAYS, SHOWN, ACTIONS = 8, 10, 2
OPSET, FORMAT = 17, 9
Weights = Sequence[Float32[np.ndarray, "inputs outputs"]]
DECLARED = """\
lidar: {rays: 8, range_m: 8.0}
inputs:
  - parts:
      - {field: ranges_m, scale: 0.125}
      - {field: goal_robot_m, scale: 0.2, low: -1, high: 1}
"""
POLICY = "9" * 64
FILE = "nav/policy.onnx"
LAUNCH = ApplicationLaunch(name="mine", version="1", digest=POLICY, package="nav", launch_file="policy")


def weights(sizes: Sequence[int] = (SHOWN, 16, 16, ACTIONS), seed: int = 0) -> Weights:
    """Returns the weights of a small network."""
    rng = np.random.default_rng(seed)
    return [rng.normal(0.0, 1.5 / np.sqrt(a), (a, b)).astype(np.float32) for a, b in itertools.pairwise(sizes)]


def network(layers: Weights, shape: Sequence[int | str] = ("lanes", SHOWN)) -> onnx.ModelProto:
    """Returns layers with tanh between them."""
    nodes, name = list[onnx.NodeProto](), "observation"
    for number in range(len(layers)):
        last = number + 1 == len(layers)
        summed = "action" if last else f"sum{number}"
        nodes.append(helper.make_node("MatMul", [name, f"weights{number}"], [summed]))
        if not last:
            name = f"layer{number}"
            nodes.append(helper.make_node("Tanh", [summed], [name]))
    made = [numpy_helper.from_array(each, f"weights{number}") for number, each in enumerate(layers)]
    return model(nodes, {"observation": shape}, {"action": ("lanes", layers[-1].shape[1])}, made)


def recurrent(hidden: int = 4) -> onnx.ModelProto:
    """Returns a network that keeps what it counted: ``(1, lanes, hidden)``, as PyTorch's GRU does."""
    nodes = [
        helper.make_node("Constant", [], ["one"], value=numpy_helper.from_array(np.ones((1, 1, hidden), np.float32))),
        helper.make_node("Add", ["kept", "one"], ["kept_next"]),
        helper.make_node("ReduceMean", ["kept_next"], ["count"], axes=[0, 2], keepdims=0),
        helper.make_node("Unsqueeze", ["count", "axis"], ["column"]),
        helper.make_node("Mul", ["column", "share"], ["turn"]),
        helper.make_node("ReduceSum", ["observation", "axis"], ["seen"], keepdims=1),
        helper.make_node("Mul", ["seen", "zero"], ["ahead"]),
        helper.make_node("Concat", ["ahead", "turn"], ["action"], axis=1),
    ]
    made = [
        numpy_helper.from_array(np.array([1], np.int64), "axis"),
        numpy_helper.from_array(np.array(0.01, np.float32), "share"),
        numpy_helper.from_array(np.array(0.0, np.float32), "zero"),
    ]
    inputs = {"observation": ("lanes", SHOWN), "kept": (1, "lanes", hidden)}
    return model(nodes, inputs, {"action": ("lanes", 2), "kept_next": (1, "lanes", hidden)}, made)


def model(
    nodes: Sequence[onnx.NodeProto],
    inputs: Mapping[str, Sequence[int | str]],
    outputs: Mapping[str, Sequence[int | str]],
    made: Sequence[onnx.TensorProto] = (),
) -> onnx.ModelProto:
    """Returns a model of some operators."""
    given, taken = (
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape)) for name, shape in each.items()]
        for each in (inputs, outputs)
    )
    graph = helper.make_graph(list(nodes), "policy", given, taken, list(made))
    domains = {node.domain for node in nodes} - {""}
    imports = [helper.make_opsetid("", OPSET), *(helper.make_opsetid(domain, 1) for domain in sorted(domains))]
    return helper.make_model(graph, opset_imports=imports, ir_version=FORMAT)


def bundle(folder: Path, network_: onnx.ModelProto | bytes, declared: str = DECLARED) -> Path:
    """Returns a folder with the courier's robot and a policy."""
    (folder / "nav").mkdir(parents=True, exist_ok=True)
    (folder / "robot.xml").write_bytes((ROOT / "applications/courier/robot.xml").read_bytes())
    content = network_ if isinstance(network_, bytes) else network_.SerializeToString()
    (folder / FILE).write_bytes(content)
    (folder / "nav/policy.yaml").write_text(declared)
    return folder
