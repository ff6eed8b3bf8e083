"""Writes a trained network as a bundle: robot, ONNX, its declaration, and what is launched on the robot."""

import shutil
from pathlib import Path

import numpy as np
import onnx
import yaml
from onnx import TensorProto, helper, numpy_helper

HERE = Path(__file__).resolve().parent
ROBOT = HERE.parents[1] / "applications" / "courier" / "robot.xml"


def write_bundle(folder, actor, lidar, parts):
    package = folder / "reactive"
    package.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROBOT, folder / "robot.xml")
    shutil.copy(HERE / "run.sh", package / "run.sh")
    nodes, tensors, name = [], [], "shown"
    for number, (weight, bias) in enumerate(actor):
        for kind, array in (("weight", weight), ("bias", bias)):
            tensors.append(numpy_helper.from_array(np.asarray(array), f"{kind}{number}"))
        last = number == len(actor) - 1
        nodes.append(
            helper.make_node("Gemm", [name, f"weight{number}", f"bias{number}"], ["action" if last else f"sum{number}"])
        )
        name = f"layer{number}"
        nodes += [] if last else [helper.make_node("Tanh", [f"sum{number}"], [name])]
    ends = [("shown", actor[0][0].shape[0]), ("action", actor[-1][1].shape[0])]
    taken, given = (helper.make_tensor_value_info(end, TensorProto.FLOAT, ["lanes", width]) for end, width in ends)
    graph = helper.make_graph(nodes, "reactive", [taken], [given], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, package / "reactive.onnx")
    declared = {"lidar": lidar, "inputs": [{"parts": parts}], "output": {"kind": "action"}}
    (package / "reactive.yaml").write_text(yaml.safe_dump(declared, sort_keys=False))
