"""The same episode, whoever runs beside it: the same commands, byte for byte."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from tasks.ros.lockstep.exchange import Launch
from tasks.ros.lockstep.step_driver import LockstepPatience
from tests.ros.lockstep.room import Driven, drive
from tests.ros.pictures import seeing, with_two_eyes
from tests.ros.random_graph import Part, part, random_graph

# Three times the default: beside other work several threads wait for a core one after the other, and only the longest
# wait is not counted. That no stage is late is asserted all the same.
PATIENCE = LockstepPatience(stage_s=6.0)
STEPS = 15
APPLICATIONS = ["answer", "listen", "steady", "relay", "wheel", "late", "chain", "hands", "race"]


def launch(bundle: Path, application: str, home: Path, lanes: int) -> Launch:
    return Launch(bundle, "courier", f"{application}.launch", home, [{}] * lanes)


@pytest.mark.long
@pytest.mark.parametrize("application", APPLICATIONS)
def test_an_episode_has_the_same_commands_in_each_of_three_lanes_and_alone(
    wheel: Path, home: Path, application: str
) -> None:
    together = drive(launch(wheel, application, home, 3), [0, 1, 0], 40, patience=PATIENCE)
    alone = drive(launch(wheel, application, home, 1), [0], 40, patience=PATIENCE)
    assert together.failures == alone.failures == {}
    assert together.digests[0] == together.digests[2] == alone.digests[0]
    tallies = [*together.tallies, *alone.tallies]
    assert [(tally.late, tally.stray, tally.commands > 0) for tally in tallies] == [(0, 0, True)] * len(tallies)


@pytest.mark.long
def test_a_node_that_begins_to_poll_in_its_episode_has_the_same_commands_in_two_lanes_and_alone(
    courier: Path, home: Path
) -> None:
    lanes = Launch(courier, "courier", "ask.launch", home, [{"AHEAD_UNTIL": "2.0"}] * 2)
    together = drive(lanes, [0, 0], 50, patience=PATIENCE)
    alone = drive(lanes._replace(environment=lanes.environment[:1]), [0], 50, patience=PATIENCE)
    assert together.failures == alone.failures == {}
    assert set(together.digests) == set(alone.digests)
    assert {(tally.late, tally.stray) for tally in (*together.tallies, *alone.tallies)} == {(0, 0)}


@pytest.mark.long
@pytest.mark.parametrize("kind", ["message", "service", "result"])
def test_a_node_gives_up_waiting_at_the_same_control_steps_alone_and_among_four_beside_burners(
    courier: Path, home: Path, kind: str, request: pytest.FixtureRequest
) -> None:
    lanes = Launch(courier, "courier", "gives_up.launch", home, [{"KIND": kind}] * 4)
    alone = drive(lanes._replace(environment=lanes.environment[:1]), [0], 40, patience=PATIENCE)
    request.getfixturevalue("burners")
    together = drive(lanes, [0] * 4, 40, patience=PATIENCE)
    assert together.failures == alone.failures == {}
    assert together.digests == alone.digests * 4
    # Each half second of two; for a service it looks each 0.3 s, so 0.15, 0.75, 1.35 and 1.95 s after the warm-up.
    tallies = {(tally.commands, tally.late, tally.stray) for tally in (*together.tallies, *alone.tallies)}
    assert tallies == {(4, 0, 0)}


@pytest.mark.long
def test_a_node_that_drives_by_pictures_has_the_same_commands_in_each_of_two_lanes_and_alone(
    courier: Path, home: Path
) -> None:
    together, alone = (
        drive(launch(courier, "see", home, lanes), [0] * lanes, 40, patience=PATIENCE, robot=seeing())
        for lanes in (2, 1)
    )
    assert together.failures == alone.failures == {}
    assert together.digests == alone.digests * 2
    # A picture at each second step, each answered.
    tallies = {(tally.commands, tally.late, tally.stray) for tally in (*together.tallies, *alone.tallies)}
    assert tallies == {(20, 0, 0)}


@pytest.mark.long
def test_a_node_that_drives_by_two_cameras_has_the_same_commands_in_each_of_two_lanes_and_alone(
    courier: Path, home: Path
) -> None:
    together, alone = (
        drive(launch(courier, "eyes", home, lanes), [0] * lanes, 40, patience=PATIENCE, robot=with_two_eyes())
        for lanes in (2, 1)
    )
    assert together.failures == alone.failures == {}
    assert together.digests == alone.digests * 2
    # It commands where both pictures are of the same moment, once each second step.
    tallies = {(tally.commands, tally.late, tally.stray) for tally in (*together.tallies, *alone.tallies)}
    assert tallies == {(20, 0, 0)}


def drive_graph(courier: Path, home: Path, graph: Mapping[str, Part], lanes: int) -> Driven:
    nodes = "".join(
        f"<node pkg='courier' type='part.py' name='{name}'>"
        f"<param name='does' type='str' value='{json.dumps(does)}'/></node>"
        for name, does in graph.items()
    )
    (courier / "courier/launch/graph.launch").write_text(f"<launch>{nodes}</launch>")
    return drive(Launch(courier, "courier", "graph.launch", home, [{}] * lanes), range(lanes), STEPS, patience=PATIENCE)


@pytest.mark.long
def test_a_random_graph_gives_the_same_commands_alone_and_among_two(courier: Path, home: Path) -> None:
    alone, both = (drive_graph(courier, home, random_graph(115), lanes) for lanes in (1, 2))
    assert alone.failures == both.failures == {}
    assert alone.digests[0] == both.digests[0]
    tallies = {(tally.late, tally.stray, tally.commands > 0) for tally in (*alone.tallies, *both.tallies)}
    assert tallies == {(0, 0, True)}


@pytest.mark.long
@pytest.mark.parametrize("kept", [False, True])
def test_nodes_that_ask_one_at_once_are_counted_as_late(courier: Path, home: Path, *, kept: bool) -> None:
    """Their commands differ from run to run, and so a column has to say it."""
    asks = part(reads="hop", writes="cmd_vel", asks="count", threads=kept)
    graph = {"first": part(reads="scan", writes="hop"), "left": asks, "right": asks, "answers": part(answers="count")}
    found = drive_graph(courier, home, graph, 1)
    assert (found.failures, found.tallies[0].late, found.tallies[0].stray) == ({}, STEPS, 0)


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(100, 120))
def test_random_graphs_give_the_same_commands_in_any_number_of_lanes_beside_burners(
    courier: Path, home: Path, seed: int, burners: None
) -> None:
    runs = [drive_graph(courier, home, random_graph(seed), lanes) for lanes in (1, 4, 8) for _ in range(3)]
    assert all(run.failures == {} for run in runs)
    assert {run.digests[0] for run in runs} == {runs[0].digests[0]}
    assert {(tally.late, tally.stray) for run in runs for tally in run.tallies} == {(0, 0)}


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("lanes", [1, 8, 32])
@pytest.mark.parametrize("application", APPLICATIONS)
def test_ten_repeats_beside_burners_have_the_same_commands(
    wheel: Path, home: Path, application: str, lanes: int, burners: None
) -> None:
    repeats = [drive(launch(wheel, application, home, lanes), range(lanes), 100, patience=PATIENCE) for _ in range(10)]
    assert [each.failures for each in repeats] == [{}] * 10
    assert all(each.digests == repeats[0].digests for each in repeats)
    assert {(tally.late, tally.stray) for each in repeats for tally in each.tallies} == {(0, 0)}
