"""One robot whose disk is full, or fails, runs what it ran and says so."""

import errno
from collections.abc import Callable

import pytest

from tasks.deploy.robot.disk import Disk
from tests.deploy.one_robot import GOOD, NAME, OneRobot
from tests.deploy.yard import STAYS_UP, eventually


def test_a_robot_without_room_says_so_and_runs_what_it_ran(one: OneRobot) -> None:
    good, big = one.yard.publish(GOOD), one.yard.publish({"run.sh": STAYS_UP + "# new\n"})
    one.deploy(good, 1)
    Disk(one.root).download(big.digest).symlink_to("/dev/full")

    reported = one.deploy(big, 2)

    assert (reported.failure_code, reported.step) == ("EnvironmentSetupError", "DownloadingExtracting")
    assert "no room for the bundle" in reported.failure_reason
    assert one.yard.current(NAME) == good.digest
    eventually(lambda: one.programs == ["sleep 1000"])


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EIO])
def test_a_robot_that_cannot_keep_its_state_refuses_and_runs_what_it_ran(
    code: int, one: OneRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    good, new = one.yard.publish(GOOD), one.yard.publish({"run.sh": STAYS_UP + "# new\n"})
    one.deploy(good, 1)
    with monkeypatch.context() as full:
        full.setattr(Disk, "save", _raising(OSError(code, "the disk says no")))
        refused = one.deploy(new, 2)
        one.robot.supervise()

    assert (refused.failure_code, refused.sequence) == ("EnvironmentSetupError", 2)
    eventually(lambda: one.programs == ["sleep 1000"])
    assert one.deploy(new, 2).status == "InSync"


def test_a_disk_that_fills_up_in_between_ends_the_deployment_and_is_written_to_later(
    one: OneRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    good, new = one.yard.publish(GOOD), one.yard.publish({"run.sh": STAYS_UP + "# new\n"})
    one.deploy(good, 1)
    with monkeypatch.context() as full:
        full.setattr(Disk, "switch", _raising(OSError(errno.ENOSPC, "full"), once=True))
        full.setattr(Disk, "save", _raising(OSError(errno.ENOSPC, "full"), after=1))
        reported = one.deploy(new, 2)
        assert (reported.failure_code, reported.step) == ("EnvironmentSetupError", "Launching")
        assert Disk(one.root).load().outcome != reported
    one.robot.supervise()

    kept = Disk(one.root).load()
    assert (kept.target, kept.running and kept.running.digest) == (None, good.digest)
    assert kept.outcome == reported


def _raising(exc: OSError, *, after: int = 0, once: bool = False) -> Callable[..., None]:
    """Returns a method that raises; after so many calls, which do nothing, or only the first time."""
    calls = [0]

    def method(self: Disk, *_: object) -> None:
        calls[0] += 1
        if calls[0] > after and not (once and calls[0] > 1):
            raise exc

    return method
