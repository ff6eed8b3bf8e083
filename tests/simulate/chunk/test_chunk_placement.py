"""What an application gets is of its own episode alone, whatever else its chunk holds, and so are its rows."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import HostMap, Placement
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.chunk.chunk_placement import alike, program_of
from tasks.simulate.geometry.lidar_scan import lidar_outlines
from tasks.simulate.geometry.obstacles import PRISM_COLUMNS, obstacles
from tasks.simulate.geometry.world_arrays import WorldArrays, arrays_of_worlds
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.sensors.lidar import NO_LIDAR
from tests.factories.simulations import DRIFT, FOLDERS, delivery, pen, pushing, simulate_lanes

# The maps have 144, 192 and 512 cells a side, the last for a world at the size limit of the finest grid.
SIDES_M = {"hand/small": 6.0, "hand/also-small": 8.0, "hand/large": 16.0, "hand/largest": 51.2}
WORLDS: Mapping[str, World] = {name: pen(side_m, number) for number, (name, side_m) in enumerate(SIDES_M.items())}
LANES = 16
COUNTED = ApplicationLaunch(name="drift", version="1", digest=DRIFT, package="drift", launch_file="counted")


def looking(index: int, world: str, launch: str = "looking") -> EpisodeRequest:
    asked = pushing(index, world=world, seed=index, duration_s=1.5, launch=launch)
    return asked.model_copy(update={"scenario": COUNTED})


def noisy(index: int, world: str) -> EpisodeRequest:
    asked = delivery(index, world=world, seed=index, duration_s=8.0)
    # So bad that a robot soon believes that it is beyond its map, where indices are clipped.
    return asked.model_copy(update={"environment": {"ODOMETRY_SIGMA": "20", "LIDAR_SIGMA": "0.05"}})


def simulated(
    requests: Sequence[EpisodeRequest], *, lanes: int = LANES, engine: str = "planar", recorder: Recorder | None = None
) -> dict[int, EpisodeResult]:
    used = {name: WORLDS[name] for name in dict.fromkeys(request.world for request in requests)}
    return {
        row.index: row
        for chunk in plan_chunks(requests, lanes)
        for row in simulate_lanes(
            chunk, used, FOLDERS, lanes=lanes, engine=engine, should_stop=lambda: False, recorder=recorder
        )
    }


def blank_lane(cells: int, goals: int, given: int, prisms: int) -> Lane:
    contacts = obstacles(pen(6.0, 1), 0.0, 1.0)._replace(prisms=np.zeros((prisms, PRISM_COLUMNS), np.float32))
    seen = lidar_outlines(contacts)
    floor = HostMap(np.zeros((cells, cells), np.float32), *(np.zeros(size, np.float32) for size in (2, (), 4)))
    placement = Placement(np.zeros(3), np.zeros((goals, 2)), (np.zeros(given),))
    arrays = WorldArrays(*cast("Any", (contacts, seen, floor, None, None, None)))
    return Lane(looking(0, "hand/small"), arrays, placement, None)


@given(
    st.lists(
        st.tuples(st.sampled_from((128, 192)), st.integers(1, 2), st.integers(1, 2), st.sampled_from((0, 32))),
        max_size=8,
    )
)
def test_lanes_of_other_shapes_are_not_driven_together(shapes: list[tuple[int, int, int, int]]):
    lanes = [blank_lane(*shape) for shape in shapes]
    parts = alike(lanes)
    assert sorted(map(id, lanes)) == sorted(id(lane) for part in parts for lane in part)
    assert [len(part) for part in parts] == [shapes.count(shape) for shape in dict.fromkeys(shapes)]


@given(st.sampled_from([*WORLDS]), st.sets(st.sampled_from([*WORLDS])))
@settings(max_examples=5, deadline=None)
def test_a_map_is_the_same_whatever_other_worlds_are_staged(name: str, others: set[str]):
    staged = [
        arrays_of_worlds({each: WORLDS[each] for each in names}, Hull(0.18, 0.02, 0.38, 2.0), NO_LIDAR.height_m)[
            name
        ].floor
        for names in ([name], [*others, name])
    ]
    assert all(np.array_equal(one, other) for one, other in zip(*staged, strict=True))


@pytest.mark.long
def test_an_application_that_looks_at_sizes_sees_those_of_its_own_episode():
    worlds = ("hand/small", "hand/large")
    requests = [looking(k, worlds[k % 2]) for k in range(12)]
    told: list[int] = []
    (chunk,) = plan_chunks(requests, LANES)
    recorder = Recorder(4.0, lambda _: True)
    rows = simulate_lanes(
        chunk,
        WORLDS,
        FOLDERS,
        lanes=LANES,
        engine="mujoco",
        should_stop=lambda: False,
        progress=told.append,
        recorder=recorder,
    )
    assert [row.index for row in rows] == list(range(12))
    seen = [(row.metrics["rows"], row.metrics["columns"], row.metrics["goals"], row.goals_total) for row in rows]
    assert seen == [(144.0, 144.0, 2.0, 2), (192.0, 192.0, 3.0, 3)] * 6
    assert told == sorted(told)
    assert told[-1] == 12
    assert sorted(recorder.episodes) == list(range(12))
    assert sorted({int(index) for part in recorder.parts() for index in part["index"]}) == list(range(12))
    assert simulated([requests[3]], engine="mujoco")[3] == rows[3]


def mixed(rng: np.random.Generator, count: int, names: Sequence[str]) -> list[EpisodeRequest]:
    return [noisy(k, str(rng.choice(names))) for k in range(count)]


@pytest.mark.soak
def test_noisy_rows_are_equal_in_any_order_with_any_lanes_and_alone():
    rng = np.random.default_rng(18)
    requests = mixed(rng, 12, ("hand/small", "hand/large"))
    together = simulated(requests)
    assert len({request.world for request in requests}) == 2
    assert simulated([requests[k] for k in rng.permutation(len(requests))]) == together
    for index in [k for k, request in enumerate(requests) if request.world == "hand/small"][:3]:
        assert simulated([requests[index]], lanes=8)[index] == together[index]


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("engine", ["planar", "mujoco", "mjx"])
def test_noisy_rows_of_random_batches_are_equal_and_20_replays_deviate_by_nothing(engine: str, seed: int):
    if engine == "mjx" and seed:
        pytest.skip("its programs take minutes to compile")
    rng = np.random.default_rng([18, seed])
    worlds, others = (("hand/small", "hand/large"), 1) if engine == "mjx" else (tuple(WORLDS), 2)
    requests = mixed(rng, 64, worlds)
    together = simulated(requests, lanes=64, engine=engine)
    for lanes in rng.choice([16, 24, 32, 40, 96], others, replace=False).tolist():
        shuffled = [requests[k] for k in rng.permutation(len(requests))]
        assert simulated(shuffled, lanes=lanes, engine=engine) == together
    for index in rng.choice(len(requests), 20, replace=False).tolist():
        assert simulated([requests[index]], lanes=64, engine=engine)[index] == together[index]


def test_nodes_of_another_ros_do_not_judge(tmp_path: Path):
    robot, judge = (
        ApplicationLaunch(name=name, version="1", digest=DRIFT, package="own", launch_file=file)
        for name, file in (("rover", "rover.launch"), ("judge", "judge.launch.py"))
    )
    (tmp_path / "own").mkdir()
    for launch in (robot, judge):
        (tmp_path / "own" / launch.launch_file).touch()
    asked = looking(0, "hand/small").model_copy(update={"robot": robot, "scenario": judge})
    with pytest.raises(BundleCrash) as crash:
        program_of(asked, {DRIFT: tmp_path}, LANES, "auto")
    assert crash.value.code == "SimulationApplicationCrash"
    assert crash.value.reason == "judge: its nodes are not of that ROS which those of rover are of"
