"""The same episode, whoever runs beside it: the same commands, byte for byte."""

from pathlib import Path

import pytest

from tasks.ros.lockstep.exchange import Launch
from tasks.ros.lockstep.step_driver import LockstepPatience
from tests.ros.lockstep.room import drive

# Three times the default: beside other work several threads wait for a core one after the other, and only the longest
# wait is not counted. That no stage is late is asserted all the same.
PATIENCE = LockstepPatience(stage_s=6.0)
APPLICATIONS = ["answer", "listen", "steady", "relay", "wheel", "late", "chain", "hands"]


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
    assert all(tally.late == tally.stray == 0 < tally.commands for tally in (*together.tallies, *alone.tallies))


@pytest.mark.long
def test_a_node_that_begins_to_poll_in_its_episode_has_the_same_commands_in_two_lanes_and_alone(
    courier: Path, home: Path
) -> None:
    lanes = Launch(courier, "courier", "ask.launch", home, [{"AHEAD_UNTIL": "2.0"}] * 2)
    together = drive(lanes, [0, 0], 50, patience=PATIENCE)
    alone = drive(lanes._replace(environment=lanes.environment[:1]), [0], 50, patience=PATIENCE)
    assert together.failures == alone.failures == {}
    assert set(together.digests) == set(alone.digests)
    assert all(tally.late == tally.stray == 0 for tally in (*together.tallies, *alone.tallies))


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
    assert all(tally.late == tally.stray == 0 for each in repeats for tally in each.tallies)
