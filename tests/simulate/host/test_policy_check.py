"""A policy that does not fit is refused before any of it runs, with everything that is wrong."""

import contextlib
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host.policy_check import CheckedPolicy, RobotNumbers, check_policy, read_network
from tests.factories.policies import DECLARED, FILE, SHOWN, bundle, model, network, recurrent, weights

ROBOT = RobotNumbers(actuators=3, ranged=2, qpos=0, qvel=0)
KEPT = f"{DECLARED}states: [{{input: kept, output: kept_next}}]\n"
SOUND = network(weights()).SerializeToString()


def checked(folder: Path, made: onnx.ModelProto | bytes, declared: str = DECLARED) -> CheckedPolicy:
    return check_policy(bundle(folder, made, declared), FILE, ROBOT)


def test_the_only_input_and_output_need_no_name(tmp_path: Path):
    found = checked(tmp_path, network(weights())).policy
    assert (found.inputs[0].name, found.output.name) == ("observation", "action")


def test_what_is_kept_is_found_by_its_open_dimension(tmp_path: Path):
    assert checked(tmp_path, recurrent(), KEPT).state_shapes == ((1, None, 4),)


def test_an_input_may_have_any_shape_of_so_many_numbers(tmp_path: Path):
    made = model([helper.make_node("Relu", ["o"], ["a"])], {"o": ("n", 1, 2, 5)}, {"a": ("n", 2)})
    assert checked(tmp_path, made).input_shapes == ((1, 2, 5),)


def test_an_input_may_be_a_picture(tmp_path: Path):
    declared = "depth_camera: {columns: 6, rows: 4}\ninputs: [{parts: [{field: depth_m, scale: 0.1}]}]\n"
    made = model([helper.make_node("Relu", ["o"], ["a"])], {"o": ("n", 1, 4, 6)}, {"a": ("n", 2)})
    assert checked(tmp_path, made, declared).input_shapes == ((1, 4, 6),)
    with pytest.raises(RobotRefused, match="depth_m: declare the robot's depth_camera"):
        checked(tmp_path / "without", made, "inputs: [{parts: [{field: depth_m}]}]\n")
    declared = "color_camera: {columns: 6, rows: 4}\ninputs: [{parts: [{field: color, scale: 0.004}]}]\n"
    made = model([helper.make_node("Relu", ["o"], ["a"])], {"o": ("n", 4, 6, 3)}, {"a": ("n", 2)})
    assert checked(tmp_path / "color", made, declared).input_shapes == ((4, 6, 3),)


def test_an_input_may_be_the_pictures_of_some_cameras(tmp_path: Path):
    cameras = "[{name: front, columns: 6, rows: 4}, {name: rear, columns: 6, rows: 4}]"
    declared = f"depth_camera: {cameras}\ninputs: [{{parts: [{{field: depth_m, scale: 0.1}}]}}]\n"
    made = model([helper.make_node("Relu", ["o"], ["a"])], {"o": ("n", 2, 4, 6)}, {"a": ("n", 2)})
    assert checked(tmp_path, made, declared).input_shapes == ((2, 4, 6),)
    declared = f"color_camera: {cameras}\ninputs: [{{parts: [{{field: color, scale: 0.004}}]}}]\n"
    made = model([helper.make_node("Relu", ["o"], ["a"])], {"o": ("n", 2, 4, 6, 3)}, {"a": ("n", 2)})
    assert checked(tmp_path / "color", made, declared).input_shapes == ((2, 4, 6, 3),)


@pytest.mark.parametrize(
    ("made", "declared", "told"),
    [
        (network(weights(), ("lanes", 12)), DECLARED, "observation of shape (lanes, 12): its parts are 10 numbers"),
        (network(weights(), (1, SHOWN)), DECLARED, "the first dimension must be open"),
        (network(weights((SHOWN, 3))), DECLARED, "output: 3 numbers a lane, where robot.xml has 2 actuators"),
        (network(weights()), DECLARED.replace("lidar", "odometry: null\n# "), "ranges_m: declare the robot's lidar"),
        (network(weights()), f"{DECLARED}      - {{field: qpos}}\n", "qpos: the robot is no more than a planar base"),
        (network(weights()), DECLARED.replace("ranges_m", "ranges"), "inputs.0.parts.0.field: 'ranges'"),
        (network(weights()), KEPT, "inputs: 'kept': the network has observation"),
        (recurrent(), DECLARED, "one has no name, and it does not follow which is meant"),
        (network(weights()), f"{DECLARED}output: {{kind: choice, controls: [[1, 0]]}}", "output.controls has 1 rows"),
        (
            network(weights()),
            f"{DECLARED}output: {{kind: choice, controls: [[1, 0], [0, 1, 2]]}}",
            "rows of 2, 3 numbers: all must have as many",
        ),
        (network(weights()), f"{DECLARED}output: {{kind: choice, controls: [[1], [2]]}}", "output: 1 numbers a lane"),
        (
            model([helper.make_node("Own", ["o"], ["a"], domain="evil.ops")], {"o": ("n", SHOWN)}, {"a": ("n", 2)}),
            DECLARED,
            "operator evil.ops::Own: libraries of operators are not loaded",
        ),
        (
            model([helper.make_node("RandomNormalLike", ["o"], ["a"])], {"o": ("n", SHOWN)}, {"a": ("n", 2)}),
            DECLARED,
            "operator RandomNormalLike: draws numbers",
        ),
        (SOUND[:-40], DECLARED, "is no network in ONNX"),
        (b"", DECLARED, "it has 0 graphs"),
        (b"\x3a\x00\x3a\x00", DECLARED, "it has 2 graphs"),
    ],
)
def test_what_does_not_fit_is_told(tmp_path: Path, made: onnx.ModelProto | bytes, declared: str, told: str):
    with pytest.raises(RobotRefused) as caught:
        checked(tmp_path, made, declared)
    assert told in str(caught.value)


def test_a_policy_without_a_declaration_is_told_what_is_missing(tmp_path: Path):
    bundle(tmp_path, SOUND)
    (tmp_path / "nav/policy.yaml").unlink()
    with pytest.raises(RobotRefused, match=r"nav/policy.yaml: is missing: it says what nav/policy.onnx is shown"):
        check_policy(tmp_path, FILE, ROBOT)


def test_numbers_in_another_file_are_refused_wherever_the_tensor_lies(tmp_path: Path):
    outside = numpy_helper.from_array(np.zeros(2, np.float32), "stolen")
    outside.data_location = TensorProto.EXTERNAL
    outside.external_data.add(key="location", value="../../../etc/passwd")
    outside.ClearField("raw_data")
    inner = helper.make_graph([helper.make_node("Constant", [], ["x"], value=outside)], "inner", [], [])
    branch = helper.make_node("If", ["c"], ["a"], then_branch=inner, else_branch=inner)
    deep = model([branch], {"o": ("n", SHOWN)}, {"a": ("n", 2)})
    plain = model([], {"o": ("n", SHOWN)}, {"a": ("n", 2)}, [outside])
    few = helper.make_sparse_tensor(outside, numpy_helper.from_array(np.arange(2), "where"), [4])
    sparse = helper.make_node("Constant", [], ["x"])
    sparse.attribute.append(onnx.AttributeProto(name="sparse_value", type="SPARSE_TENSOR", sparse_tensor=few))
    thin = model([sparse], {"o": ("n", SHOWN)}, {"a": ("n", 2)})
    default = onnx.AttributeProto(name="value", type="TENSOR", t=outside)
    own = onnx.FunctionProto(name="f", domain="ai.onnx", attribute_proto=[default])
    called = model([], {"o": ("n", SHOWN)}, {"a": ("n", 2)})
    called.functions.append(own)
    for made in (deep, plain, thin, called):
        with pytest.raises(RobotRefused, match="the numbers of stolen lie in another file"):
            checked(tmp_path, made)


def test_a_network_that_leads_out_of_its_bundle_is_refused(tmp_path: Path):
    bundle(tmp_path / "bundle", SOUND)
    (tmp_path / "secret").write_bytes(SOUND)
    (tmp_path / "bundle/nav/policy.onnx").unlink()
    (tmp_path / "bundle/nav/policy.onnx").symlink_to(tmp_path / "secret")
    with pytest.raises(RobotRefused, match="leads out of the bundle"):
        check_policy(tmp_path / "bundle", FILE, ROBOT)


def test_graphs_without_end_are_refused(tmp_path: Path):
    graph = helper.make_graph([], "g", [], [])
    for _ in range(20):
        graph = helper.make_graph([helper.make_node("Loop", [], ["a"], body=graph)], "g", [], [])
    with pytest.raises(RobotRefused, match="graphs lie more than 16 deep"):
        checked(tmp_path, helper.make_model(graph))


def test_a_file_that_would_grow_as_it_is_read_is_refused(tmp_path: Path):
    size, nodes = bytearray(), b"\x0a\x00" * 100_001
    left = len(nodes)
    while left:
        size.append(left & 0x7F | (0x80 if left > 0x7F else 0))
        left >>= 7
    with pytest.raises(RobotRefused, match="more than 100,000 operators"):
        checked(tmp_path, b"\x3a" + bytes(size) + nodes)


def test_a_network_is_read_as_onnx_reads_it(tmp_path: Path):
    path = bundle(tmp_path, recurrent()) / "nav/policy.onnx"
    found, theirs = read_network(path, "policy.onnx"), onnx.load(path)
    for ours, values in ((found.inputs, theirs.graph.input), (found.outputs, theirs.graph.output)):
        assert [each.name for each in ours] == [value.name for value in values]
        assert [each.kind for each in ours] == [value.type.tensor_type.elem_type for value in values]
        assert [each.shape for each in ours] == [
            tuple(each.dim_param or each.dim_value for each in value.type.tensor_type.shape.dim) for value in values
        ]
    assert found.operators == {(node.domain, node.op_type) for node in theirs.graph.node}


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, len(SOUND) - 1), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(0, len(SOUND)),
)
def test_bytes_that_were_changed_or_cut_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, int]], end: int
):
    found = bytearray(SOUND)
    for place, byte in changes:
        found[place] = byte
    path = tmp_path_factory.mktemp("changed") / "policy.onnx"
    path.write_bytes(bytes(found[:end]))
    with contextlib.suppress(RobotRefused):
        read_network(path, "policy.onnx")
