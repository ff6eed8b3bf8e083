"""Writes a trained network as a bundle: robot, ONNX, its declaration, and what is launched on the robot."""

import shutil
from pathlib import Path

import numpy as np
import onnx
import yaml
from onnx import TensorProto, helper, numpy_helper

HERE = Path(__file__).resolve().parent
ROBOT = HERE.parents[1] / "applications" / "courier" / "robot.xml"


class Graph:
    """A network that is put together, operator by operator."""

    def __init__(self, name):
        self.name = name
        self.nodes, self.tensors = [], []

    def add(self, operator, inputs, output, **attributes):
        """Adds an operator, whose inputs are names or arrays, and returns its output's name."""
        names = []
        for number, each in enumerate(inputs):
            names.append(each if isinstance(each, str) else f"{output}.{number}")
            if not isinstance(each, str):
                self.tensors.append(numpy_helper.from_array(np.asarray(each), names[-1]))
        self.nodes.append(helper.make_node(operator, names, [output], **attributes))
        return output

    def dense(self, shown, layers, output):
        """Adds layers (weight, bias) with tanh between them, and returns the last one's output."""
        for number, layer in enumerate(layers[:-1]):
            shown = self.add("Tanh", [self.add("Gemm", [shown, *layer], f"sum{number}")], f"layer{number}")
        return self.add("Gemm", [shown, *layers[-1]], output)


def write_bundle(folder, graph, inputs, outputs, declared):
    """Writes it; ``inputs`` and ``outputs`` are the shapes of what it is shown and says of one robot, by name."""
    name = graph.name
    package = folder / name
    package.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROBOT, folder / "robot.xml")
    shutil.copy(HERE / "run.sh", package / "run.sh")
    taken, given = (
        [helper.make_tensor_value_info(end, TensorProto.FLOAT, ["lanes", *shape]) for end, shape in ends.items()]
        for ends in (inputs, outputs)
    )
    made = helper.make_graph(graph.nodes, name, taken, given, graph.tensors)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, package / f"{name}.onnx")
    declared = {"output": {"kind": "action"}, **declared}
    (package / f"{name}.yaml").write_text(yaml.safe_dump(declared, sort_keys=False))
