"""Episodes of policies in ONNX: each lane has its own memory, and its row does not depend on other lanes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import Observation
from tasks.simulate.host.controllers import HostBundle, HostControllers, HostStart
from tasks.simulate.host.onnx_policy import LaneNetwork, onnx_application
from tasks.simulate.host.policy_check import RobotNumbers, check_policy
from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.sensors.sensor_table import sensors_of
from tests.factories.policies import DECLARED, FILE, LAUNCH, POLICY, SHOWN, bundle, model, network, recurrent, weights
from tests.factories.simulations import FOLDERS, pushing, simulate_lanes

KEPT = f"{DECLARED}states: [{{input: kept, output: kept_next}}]\n"
FAR = DECLARED.replace("scale: 0.2, low: -1, high: 1", "scale: 1")
LANES = 24
MOVING = np.ones(8, bool)
SHOWN_ALL, ACTED = {"observation": ("n", SHOWN)}, {"action": ("n", 2)}
# The goal, which the network is shown last.
PICKED = [
    numpy_helper.from_array(np.array([n], np.int64), name) for name, n in (("first", 8), ("end", 10), ("axis", 1))
]


def request(index: int, duration_s: float = 2.0) -> EpisodeRequest:
    drawn = pushing(index, world=f"hand/pen-{index % 3}", seed=index, duration_s=duration_s)
    return drawn.model_copy(update={"robot": LAUNCH})


def run(
    folder: Path, pens: dict[str, World], requests: list[EpisodeRequest], lanes: int = LANES
) -> list[EpisodeResult]:
    return [
        row
        for chunk in plan_chunks(requests, lanes)
        for row in simulate_lanes(
            chunk, pens, {**FOLDERS, POLICY: folder}, lanes=lanes, should_stop=lambda: False, engine="planar"
        )
    ]


def begun(folder: Path) -> HostControllers:
    """Returns the controllers of eight lanes that hold no episodes."""
    application = onnx_application(HostBundle(folder, LAUNCH))
    return application.start(HostStart([], 8, 3, sensors_of(application.declare({}))))


def seen(goals_m: Sequence[Sequence[float]] = ()) -> Observation:
    """Returns what eight lanes sense whose first have these goals."""
    zero, two, three = np.zeros(8, np.float32), np.zeros((8, 2), np.float32), np.zeros((8, 3), np.float32)
    two[: len(goals_m)] = np.asarray(goals_m, np.float32).reshape(-1, 2)
    fields: Any = (zero, three, three, np.zeros((8, 8), np.float32), zero, two, two, np.zeros((8, 0), bool))
    return Observation(*fields)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bundle(tmp_path_factory.mktemp("policy"), network(weights()))


@pytest.fixture(scope="module")
def rows(folder: Path, pens: dict[str, World]) -> list[EpisodeResult]:
    return run(folder, pens, [request(k) for k in range(LANES)])


@pytest.mark.long
def test_it_drives(rows: list[EpisodeResult]):
    assert {(row.status, row.engine, row.simulated_s) for row in rows} == {("Completed", "planar", 2.0)}
    assert len({row.path_length_m for row in rows}) == LANES


@pytest.mark.long
def test_a_lane_alone_is_the_lane_among_others(rows: list[EpisodeResult], folder: Path, pens: dict[str, World]):
    assert run(folder, pens, [request(13)]) == [rows[13]]


@pytest.mark.long
def test_a_chunk_in_parts_has_the_same_rows(rows: list[EpisodeResult], folder: Path, pens: dict[str, World]):
    assert run(folder, pens, [request(k) for k in range(LANES)], lanes=8) == rows


@pytest.mark.long
def test_a_network_that_sees_drives_the_same_alone_and_among_others(tmp_path: Path, pens: dict[str, World]):
    camera = "depth_camera: {columns: 6, rows: 4, rate_hz: 10, sigma_m_per_m2: 0.01}\n"
    others = (
        "wheel_encoders: {latency_steps: 2}\ncompass: {sigma_ut: 1}\ncliff_sensors: {}\ngps: {rate_hz: 5, sigma_m: 1}\n"
    )
    parts = "{field: depth_m, scale: 0.1}, {field: ticks, scale: 0.01}, {field: field_ut, scale: 0.01}"
    declared = f"{camera}{others}inputs: [{{parts: [{parts}, {{field: cliff_m}}, {{field: gps_m, scale: 0.1}}]}}]\n"
    seer = bundle(tmp_path, network(weights((35, 16, 2)), ("lanes", 35)), declared)
    rows = run(seer, pens, [request(k) for k in range(3)], 8)
    assert {(row.status, row.failure_reason) for row in rows} == {("Completed", "")}
    assert len({row.path_length_m for row in rows}) == 3
    assert run(seer, pens, [request(2)], 8) == [rows[2]]


@pytest.mark.long
def test_what_is_kept_drives_the_robot(tmp_path: Path, pens: dict[str, World]):
    rows = run(bundle(tmp_path, recurrent(), KEPT), pens, [request(0, 1.0), request(1, 2.0)], 8)
    # The network asks for 0.01 of the 3 rad/s more at each step, which the motor follows a little later.
    turned = [row.trajectory[-1][3] - row.trajectory[0][3] for row in rows]
    assert turned[1] == pytest.approx(0.03 * 0.05 * 40 * 41 / 2, rel=0.15)
    assert turned[1] > 3.5 * turned[0] > 0.0


def test_what_is_kept_is_each_lanes_own(tmp_path: Path):
    controllers = begun(bundle(tmp_path, recurrent(), KEPT))
    asked = [controllers.controls(seen(), MOVING)[:, 1].tolist() for _ in range(3)]
    assert asked == [pytest.approx([0.03 * step] * 8) for step in (1, 2, 3)]


def test_one_lanes_answer_that_is_no_number_is_its_own_crash(tmp_path: Path):
    # The square root of a goal behind the robot is no number.
    nodes = [helper.make_node("Slice", ["observation", "first", "end", "axis"], ["goal"])]
    made = model([*nodes, helper.make_node("Sqrt", ["goal"], ["action"])], SHOWN_ALL, ACTED, PICKED)
    controllers = begun(bundle(tmp_path, made))
    controls = controllers.controls(seen([[1.0, 1.0], [-1.0, 1.0]]), MOVING)
    assert np.isfinite(controls).all(axis=1).tolist() == [True, False, *[True] * 6]
    assert controllers.crashes == {}


def test_a_network_that_raises_is_the_crash_of_all_lanes_that_move(tmp_path: Path):
    nodes = [
        helper.make_node("Slice", ["observation", "first", "end", "axis"], ["goal"]),
        helper.make_node("ReduceMax", ["goal"], ["most"], keepdims=0),
        helper.make_node("Greater", ["most", "far"], ["late"]),
        helper.make_node("Cast", ["late"], ["index"], to=onnx.TensorProto.INT64),
        helper.make_node("Gather", ["one", "index"], ["share"]),
        helper.make_node("Mul", ["goal", "share"], ["action"]),
    ]
    more = [
        numpy_helper.from_array(np.array(100.0, np.float32), "far"),
        numpy_helper.from_array(np.array([1.0], np.float32), "one"),
    ]
    controllers = begun(bundle(tmp_path, model(nodes, SHOWN_ALL, ACTED, [*PICKED, *more]), FAR))
    assert np.isfinite(controllers.controls(seen([[1.0, 1.0]]), MOVING)).all()
    moving = np.arange(8) < 3
    for _ in range(2):
        assert np.isnan(controllers.controls(seen([[1.0, 500.0]]), moving)).all()
    assert {*controllers.crashes} == {0, 1, 2}
    assert "policy.onnx: " in controllers.crashes[0]


def test_a_policy_that_does_not_fit_says_so_when_it_is_loaded(tmp_path: Path):
    with pytest.raises(BundleCrash, match=r"mine: nav/policy.yaml: output: 5 numbers a lane, where robot.xml has 2"):
        begun(bundle(tmp_path, network(weights((SHOWN, 5)))))


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("{kind: action}", [[-1.0, 3.0, 0.0], [0.5, -1.5, 0.0]]),
        ("{kind: controls}", [[-2.0, 4.0, 0.0], [0.5, -0.5, 0.0]]),
        ("{kind: choice, controls: [[1, 2], [3, 4]]}", [[3.0, 4.0, 0.0], [1.0, 2.0, 0.0]]),
        ("{kind: choice, controls: [[1, 2, 3], [4, 5, 6]]}", [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]),
    ],
)
def test_the_answer_means_what_is_declared(tmp_path: Path, output: str, expected: list[list[float]]):
    picked = helper.make_node("Slice", ["observation", "first", "end", "axis"], ["action"])
    folder = bundle(tmp_path, model([picked], SHOWN_ALL, ACTED, PICKED), f"{FAR}output: {output}\n")
    assert begun(folder).controls(seen([[-2.0, 4.0], [0.5, -0.5]]), MOVING)[:2].tolist() == expected


def test_a_score_that_is_no_number_chooses_nothing(tmp_path: Path):
    picked = helper.make_node("Slice", ["observation", "first", "end", "axis"], ["action"])
    declared = f"{FAR}output: {{kind: choice, controls: [[1, 2], [3, 4]]}}\n"
    controllers = begun(bundle(tmp_path, model([picked], SHOWN_ALL, ACTED, PICKED), declared))
    assert np.isnan(controllers.controls(seen([[np.nan, 1.0]]), MOVING)[0, :2]).all()


def loaded(folder: Path, made: onnx.ModelProto, declared: str = DECLARED, lanes: int = 64) -> LaneNetwork:
    return LaneNetwork(check_policy(bundle(folder, made, declared), FILE, RobotNumbers(3, 2, 0, 0)), lanes)


@pytest.mark.parametrize("lanes", [8, 24, 256])
def test_rows_of_networks_do_not_depend_on_how_many_there_are(tmp_path: Path, lanes: int):
    whole, some = (loaded(tmp_path, network(weights((SHOWN, 64, 64, 2))), lanes=count) for count in (256, lanes))
    shown = np.random.default_rng(1).standard_normal((256, SHOWN), np.float32)
    assert some.answer([shown[:lanes]], []).output.tobytes() == whole.answer([shown], []).output[:lanes].tobytes()


def test_a_network_that_mixes_its_lanes_is_refused(tmp_path: Path):
    nodes = [
        helper.make_node("ReduceMean", ["observation"], ["mean"], axes=[0], keepdims=1),
        helper.make_node("Sub", ["observation", "mean"], ["centred"]),
        helper.make_node("MatMul", ["centred", "w"], ["action"]),
    ]
    made = model(nodes, SHOWN_ALL, ACTED, [numpy_helper.from_array(weights((SHOWN, 2))[0], "w")])
    with pytest.raises(BundleCrash, match="a lane's answer follows from the other lanes"):
        loaded(tmp_path, made)


def test_a_network_whose_last_bits_follow_from_the_number_of_lanes_runs_a_vector_of_them_at_a_time(tmp_path: Path):
    nodes = [
        helper.make_node("Shape", ["observation"], ["lanes"], start=0, end=1),
        helper.make_node("Cast", ["lanes"], ["count"], to=onnx.TensorProto.FLOAT),
        helper.make_node("Slice", ["observation", "first", "end", "axis"], ["goal"]),
        helper.make_node("Mul", ["goal", "count"], ["action"]),
    ]
    made = model(nodes, SHOWN_ALL, ACTED, PICKED)
    assert loaded(tmp_path, made).lanes_at_once == 8
    assert loaded(tmp_path / "sound", network(weights())).lanes_at_once == 64
