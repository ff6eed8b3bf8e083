"""One robot: what it accepts, refuses, survives and takes up again."""

import errno
import hashlib
import os
import signal
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path

import pytest

from specs.errors import StoreUnreachable
from specs.field_types import S3Object
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.robot.disk import Disk, RobotState
from tasks.deploy.robot.install import StepFailed
from tasks.deploy.robot.launch import LaunchPlace, RunningApplication
from tasks.deploy.robot.processes import Stop, StopRequested
from tasks.deploy.robot.reported_state import Reporter
from tasks.deploy.robot.update import RobotUpdater
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.deploy.one_robot import GOOD, NAME, OneRobot, desired, scripted
from tests.deploy.yard import PATIENCE_S, STAYS_UP, Yard, marked_by
from tests.servers.eventually import eventually

# Stays up until the test lets it crash, however long a launch's grace lasts.
CRASHES = """#!/bin/sh
echo up >> "$HOME/launches"
until [ -e "$HOME/crash" ]; do sleep 0.01; done
exit 7
"""


def _condition(one: OneRobot, script: str) -> tuple[S3Object, str]:
    bucket = open_bucket(one.yard.store, "conditions")
    return S3Object(bucket="conditions", key="ready.sh"), bucket.put("ready.sh", script.encode())


@pytest.mark.parametrize(
    ("script", "code"), [("#!/bin/sh\n", None), ("#!/bin/sh\nexit 1\n", "DownloadConditionFailed")]
)
def test_the_download_condition_decides_before_the_download(script: str, code: str | None, one: OneRobot) -> None:
    condition, _ = _condition(one, script)

    reported = one.deploy(one.yard.publish(GOOD), 1, condition=condition)

    assert reported.failure_code == code
    assert (reported.status == "InSync") == any((one.root / "versions").iterdir())


def test_a_download_condition_with_another_etag_is_not_run(one: OneRobot) -> None:
    condition, etag = _condition(one, '#!/bin/sh\ntouch "$HOME/ran"\n')
    pinned = condition.model_copy(update={"etag": "0" * len(etag)})

    reported = one.deploy(one.yard.publish(GOOD), 1, condition=pinned)

    assert reported.failure_code == "EtagMismatch"
    assert not (one.root / "ran").exists()
    assert (
        one.deploy(one.yard.publish(GOOD), 2, condition=condition.model_copy(update={"etag": etag})).status == "InSync"
    )


def test_a_lower_sequence_is_refused_also_after_a_restart(one: OneRobot) -> None:
    newer, older = one.yard.publish(GOOD), one.yard.publish({"run.sh": STAYS_UP + "# older\n"})
    one.deploy(newer, 7)

    assert one.deploy(older, 6).deployment == "dep-7"
    one.robot.end()
    one.restarted().recover()
    assert one.deploy(older, 6).deployment == "dep-7"
    assert one.yard.current(NAME) == newer.digest


def test_a_controller_that_was_replaced_is_refused_also_after_a_restart(one: OneRobot) -> None:
    newer, older = one.yard.publish(GOOD), one.yard.publish({"run.sh": STAYS_UP + "# older\n"})
    one.deploy(newer, 1, deployment="dep", epoch=2)

    assert one.deploy(older, 2, deployment="dep", epoch=1).sequence == 1
    one.robot.end()
    one.restarted().recover()
    assert one.deploy(older, 2, deployment="dep", epoch=1).sequence == 1
    assert one.yard.current(NAME) == newer.digest
    assert one.deploy(older, 2, deployment="another", epoch=1).sequence == 2


def test_the_same_sequence_again_launches_nothing_again(one: OneRobot) -> None:
    version = one.yard.publish(GOOD)
    one.deploy(version, 1)
    eventually((one.root / "launches").exists)

    one.deploy(version, 1)

    assert (one.root / "launches").read_text() == "up\n"


def test_what_is_meant_for_another_robot_is_refused(one: OneRobot) -> None:
    version = one.yard.publish(GOOD)

    one.robot.accept(desired(version, 1, robot="r2"))

    assert read_reported(one.yard.store, NAME) is None
    assert one.programs == []


@pytest.mark.parametrize(
    ("scripts", "launch", "code", "step"),
    [
        (
            {**GOOD, "x.sh": "#!/bin/sh\nexit 9\n"},
            {"preLaunchFile": "x.sh"},
            "PreLaunchFileFailure",
            "ExecutingPreLaunch",
        ),
        (
            {**GOOD, "x.sh": "#!/bin/sh\nexit 9\n"},
            {"postLaunchFile": "x.sh"},
            "PostLaunchFileFailure",
            "ExecutingPostLaunch",
        ),
        (GOOD, {"preLaunchFile": "none.sh"}, "PreLaunchFileFailure", "ExecutingPreLaunch"),
        (GOOD, {"launchFile": "none.sh"}, "MissingRobotDeploymentResource", "Launching"),
        (GOOD, {"launchFile": ".."}, "MissingRobotDeploymentResource", "Validating"),
        ({"run.sh": "no program"}, {}, "EnvironmentSetupError", "Launching"),
    ],
)
def test_a_failing_step_is_reported_and_the_version_before_runs_on(
    scripts: Mapping[str, str], launch: Mapping[str, str], code: str, step: str, one: OneRobot
) -> None:
    good = one.yard.publish({"run.sh": STAYS_UP + "# good\n"})
    one.deploy(good, 1)

    reported = one.deploy(one.yard.publish(scripts), 2, launch=scripted(**launch))

    assert (reported.status, reported.failure_code, reported.step) == ("Failed", code, step)
    assert reported.failure_reason
    assert one.yard.current(NAME) == good.digest
    eventually(lambda: one.programs == ["sleep 1000"])  # a moment ago it was started again


def test_an_application_that_ends_soon_is_reported_and_the_version_before_runs_on(one: OneRobot) -> None:
    good = one.yard.publish({"run.sh": STAYS_UP + "# good\n"})
    one.deploy(good, 1)
    one.robot.end()
    one.restarted(PATIENCE_S).recover()

    reported = one.deploy(one.yard.publish({"run.sh": "#!/bin/sh\nexit 0\n"}), 2)

    assert (reported.status, reported.failure_code, reported.step) == ("Failed", "EnvironmentSetupError", "Launching")
    assert "run.sh" in reported.failure_reason
    assert one.yard.current(NAME) == good.digest
    eventually(lambda: one.programs == ["sleep 1000"])  # a moment ago it was started again


def test_a_first_version_that_fails_leaves_nothing_running(one: OneRobot) -> None:
    one.restarted(PATIENCE_S)
    reported = one.deploy(one.yard.publish({"run.sh": "#!/bin/sh\nexit 1\n"}), 1)

    assert reported.status == "Failed"
    assert (one.yard.current(NAME), one.programs) == ("", [])


def test_a_bundle_that_is_not_in_the_store_fails_the_robot(one: OneRobot) -> None:
    reported = one.deploy(one.yard.publish(GOOD), 1, digest="0" * 64)

    assert (reported.failure_code, reported.step) == ("MissingRobotDeploymentResource", "DownloadingExtracting")


class AwayStore:
    """A store that is away for a number of downloads and reports."""

    def __init__(self, store: Store, failures: int) -> None:
        self._store = store
        self.failures = failures

    def __getattr__(self, name: str) -> Callable[..., object]:
        def call(*arguments: object) -> object:
            if self.failures:
                self.failures -= 1
                raise StoreUnreachable("away")
            return getattr(self._store, name)(*arguments)

        return call


def test_a_store_that_is_away_for_a_while_delays_and_loses_nothing(yard: Yard) -> None:
    version = yard.publish(GOOD)
    away = AwayStore(yard.store, failures=4)
    place = LaunchPlace(robot=NAME, disk=Disk(yard.root(NAME)), stop=Stop(), grace_s=0.05)
    robot = RobotUpdater(away, place, Reporter(away, NAME))  # pyright: ignore[reportArgumentType] - forwards every method
    try:
        robot.accept(desired(version, 1))
        away.failures = 1
        robot.accept(desired(version, 2))
        robot.supervise()

        reported = read_reported(yard.store, NAME)
        assert reported is not None
        assert (reported.status, reported.sequence) == ("InSync", 2)
    finally:
        robot.end()


def test_a_store_that_stays_away_fails_the_deployment_at_its_timeout(yard: Yard) -> None:
    version = yard.publish(GOOD)
    away = AwayStore(yard.store, failures=10**9)
    disk = Disk(yard.root(NAME))
    robot = RobotUpdater(away, LaunchPlace(NAME, disk, Stop(), 0.05), Reporter(away, NAME))  # pyright: ignore[reportArgumentType] - same

    robot.accept(desired(version, 1, timeout_s=0.3))

    outcome = disk.load().outcome
    assert outcome is not None
    assert outcome.failure_code == "RobotAgentConnectionTimeout"


def test_a_robot_that_is_stopped_in_a_script_takes_the_deployment_up_at_its_next_start(one: OneRobot) -> None:
    script = '#!/bin/sh\ntest -e "$HOME/second" && exit 0\ntouch "$HOME/second"\nsleep 2000\n'
    version = one.yard.publish({**GOOD, "slow.sh": script})

    one.stop = _StopWhen(one.root / "second")
    one.restarted()
    with pytest.raises(StopRequested):
        one.robot.accept(desired(version, 1, launch=scripted(preLaunchFile="slow.sh")))
    one.robot.end()
    assert one.programs == []

    one.stop = Stop()
    one.restarted().recover()

    reported = read_reported(one.yard.store, NAME)
    assert reported is not None
    assert (reported.status, reported.sequence) == ("InSync", 1)


class _StopWhen(Stop):
    """Requested as soon as a file appears."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def sleep(self, seconds: float) -> None:
        if self._path.exists():
            self.request()
        super().sleep(seconds)


def test_a_robot_whose_state_was_set_aside_takes_its_latest_again_and_nothing_older(one: OneRobot) -> None:
    older, newer = one.yard.publish({"run.sh": STAYS_UP + "# older\n"}), one.yard.publish(GOOD)
    one.deploy(older, 6)
    one.deploy(newer, 7)
    one.robot.end()
    (one.root / "state.json").write_text("{")
    one.yard.store.delete(bundle_key(newer.digest))  # it is here already

    one.restarted().recover()

    assert one.yard.current(NAME) == newer.digest
    assert one.deploy(older, 6).sequence == 7
    assert one.programs == []
    reported = one.deploy(newer, 7)
    assert (reported.status, reported.sequence) == ("InSync", 7)
    eventually(lambda: one.programs == ["sleep 1000"])


def test_a_download_goes_on_after_a_restart(one: OneRobot) -> None:
    version = one.yard.publish(GOOD, padding_bytes=3 << 20)
    body = one.yard.store.get(bundle_key(version.digest)).body
    one.robot.accept(desired(version, 1, timeout_s=0.0, digest="0" * 64))
    state = RobotState(sequence=2, target=desired(version, 2))
    one.robot.end()
    Disk(one.root).save(state)
    Disk(one.root).download(version.digest).write_bytes(body[: 2 << 20])
    one.store = CountingStore(one.yard.store)

    one.restarted().recover()

    reported = read_reported(one.yard.store, NAME)
    assert reported is not None
    assert (reported.status, one.yard.current(NAME)) == ("InSync", version.digest)
    assert one.store.first_bytes == [2 << 20]
    assert list((one.root / "downloads").iterdir()) == []


@pytest.mark.long
def test_an_application_that_crashes_during_a_download_is_started_again(one: OneRobot) -> None:
    def crashed_three_times() -> bool:
        (one.root / "crash").touch()
        return (one.root / "launches").read_text().count("up") > 3

    one.deploy(one.yard.publish({"run.sh": CRASHES}), 1)
    eventually((one.root / "launches").exists)
    one.store = WaitingStore(one.yard.store, crashed_three_times)
    one.robot.end()
    one.restarted().recover()

    assert one.deploy(one.yard.publish(GOOD), 2, timeout_s=60.0).status == "InSync"
    assert one.store.waited


class _Forwarding:
    def __init__(self, store: Store) -> None:
        self._store = store

    def __getattr__(self, name: str) -> Callable[..., object]:
        return getattr(self._store, name)


class CountingStore(_Forwarding):
    """A store that notes from which byte on bundles are read."""

    def __init__(self, store: Store) -> None:
        super().__init__(store)
        self.first_bytes: list[int] = []

    def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
        self.first_bytes.append(first_byte)
        return self._store.blocks(key, first_byte)


class WaitingStore(_Forwarding):
    """A store that is away for downloads until something has happened."""

    def __init__(self, store: Store, happened: Callable[[], bool]) -> None:
        super().__init__(store)
        self.waited = 0
        self._happened = happened

    def size(self, key: str) -> int:
        if not self._happened():
            self.waited += 1
            raise StoreUnreachable("away")
        return self._store.size(key)


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tasks.deploy.robot.launch._FIRST_PAUSE_S", 0.001)


def supervised(one: OneRobot, status: str) -> Reported:
    (one.root / "crash").touch()

    def look() -> bool:
        one.robot.supervise()
        time.sleep(0.002)
        reported = read_reported(one.yard.store, NAME)
        return reported is not None and reported.status == status

    eventually(look)
    found = read_reported(one.yard.store, NAME)
    assert found
    return found


def test_a_crash_loop_goes_back_and_is_told(one: OneRobot) -> None:
    good, bad = one.yard.publish(GOOD), one.yard.publish({"run.sh": CRASHES})
    one.deploy(good, 1)
    assert one.deploy(bad, 2).status == "InSync"

    told = supervised(one, "Failed")

    assert (told.deployment, told.failure_code, told.running_digest) == ("dep-2", "EnvironmentSetupError", good.digest)
    assert told.failure_reason.startswith(
        "the application ended 5 times, each soon after its start; run.sh exited with 7"
    )
    assert told.failure_reason.endswith(f"went back to version {good.number}")
    assert one.yard.current(NAME) == good.digest
    assert [program for program in one.programs if "sleep 1000" in program]


def test_a_robot_that_cannot_go_back_says_so_and_also_when_it_can(
    one: OneRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    good, bad = one.yard.publish(GOOD), one.yard.publish({"run.sh": "#!/bin/sh\nexit 3\n"})
    one.deploy(good, 1)
    monkeypatch.setattr("tasks.deploy.robot.update._RESTORE_AGAIN_S", 0.0)
    with monkeypatch.context() as broken:
        broken.setattr(RunningApplication, "__init__", _failing_for(good.digest))
        told = one.deploy(bad, 2)
        one.robot.supervise()

    assert (told.status, told.running_digest, told.is_up) == ("Failed", good.digest, False)
    assert told.failure_reason.endswith(f"; cannot go back to version {good.number}: no camera")
    assert one.programs == []
    one.robot.supervise()
    later = read_reported(one.yard.store, NAME)
    assert later == told.model_copy(update={"is_up": True})
    eventually(lambda: one.programs == ["sleep 1000"])


def _failing_for(digest: str) -> Callable[..., None]:
    begin = RunningApplication.__init__

    def fail(self: RunningApplication, place: LaunchPlace, desired: Desired, bring: Callable[[Desired], None]) -> None:
        if desired.digest == digest:
            raise StepFailed("BadPermissionError", "no camera")
        begin(self, place, desired, bring)

    return fail


def test_a_robot_without_a_version_before_says_so(one: OneRobot) -> None:
    told = one.deploy(one.yard.publish({"run.sh": "#!/bin/sh\nexit 3\n"}), 1)
    assert (told.running_digest, told.is_up) == ("", True)
    assert told.failure_reason.endswith("; there is no version to go back to")


def test_after_a_restart_it_still_runs_what_it_went_back_to(one: OneRobot) -> None:
    good, bad = one.yard.publish(GOOD), one.yard.publish({"run.sh": CRASHES})
    one.deploy(good, 1)
    one.deploy(bad, 2)
    supervised(one, "Failed")
    one.robot.end()
    one.restarted().recover()
    assert one.yard.current(NAME) == good.digest
    reported = read_reported(one.yard.store, NAME)
    assert reported
    assert reported.status == "Failed"


def test_the_only_version_there_is_is_tried_for_ever_and_that_is_told(one: OneRobot) -> None:
    bad = one.yard.publish({"run.sh": CRASHES})
    one.deploy(bad, 1)

    told = supervised(one, "Failed")
    assert (told.running_digest, told.is_up) == (bad.digest, False)
    assert told.failure_reason.endswith("there is no version to go back to: it is tried again and again")

    def often() -> bool:
        one.robot.supervise()
        return len((one.root / "launches").read_text().splitlines()) > 7

    eventually(often)
    assert one.yard.current(NAME) == bad.digest


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


def _changed(one: OneRobot, digest: str) -> Path:
    """Puts another program in the place of a version's."""
    script = one.root / "versions" / digest / "courier/run.sh"
    script.parent.mkdir(parents=True, exist_ok=True)
    script.write_text('#!/bin/sh\ntouch "$HOME/owned"\nexec sleep 1000\n')
    script.chmod(0o755)
    return script


def test_what_lies_in_the_place_of_a_version_is_not_taken_for_it(one: OneRobot) -> None:
    version = one.yard.publish(GOOD)
    script = _changed(one, version.digest)

    assert one.deploy(version, 1).status == "InSync"

    assert (script.read_text(), (one.root / "owned").exists()) == (STAYS_UP, False)


@pytest.mark.parametrize("archive_is_changed", [False, True])
def test_a_version_that_was_changed_is_put_right_before_it_runs_again(
    one: OneRobot, *, archive_is_changed: bool
) -> None:
    version = one.yard.publish(GOOD)
    one.deploy(version, 1)
    one.robot.end()
    script = _changed(one, version.digest)
    if archive_is_changed:
        (one.root / "archives" / version.digest).write_bytes(b"another")

    one.restarted().recover()

    assert script.read_text() == STAYS_UP
    eventually(lambda: one.programs == ["sleep 1000"])
    assert not (one.root / "owned").exists()


def test_a_version_that_cannot_be_put_right_does_not_run_until_it_can(
    one: OneRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    version = one.yard.publish(GOOD)
    one.deploy(version, 1, timeout_s=0.0)
    one.robot.end()
    _changed(one, version.digest)
    (one.root / "archives" / version.digest).unlink()
    monkeypatch.setattr("tasks.deploy.robot.update._RESTORE_AGAIN_S", 0.0)
    kept = one.yard.store.get(bundle_key(version.digest)).body
    one.yard.store.delete(bundle_key(version.digest))

    one.restarted().recover()
    one.robot.supervise()
    assert one.programs == []
    one.yard.store.put(bundle_key(version.digest), kept)
    one.robot.supervise()

    eventually(lambda: one.programs == ["sleep 1000"])
    assert not (one.root / "owned").exists()


def test_a_store_that_is_away_makes_no_crash_loop(one: OneRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    good, new = one.yard.publish(GOOD), one.yard.publish({"run.sh": f"{STAYS_UP}# new"})
    one.deploy(good, 1)
    one.deploy(new, 2)
    kept = one.yard.store.get(bundle_key(new.digest)).body
    one.yard.store.delete(bundle_key(new.digest))
    _changed(one, new.digest)
    (one.root / "archives" / new.digest).unlink()
    for pid in marked_by(one.root):
        os.kill(pid, signal.SIGKILL)

    for _ in range(40):
        one.robot.supervise()
        time.sleep(0.005)
    told = read_reported(one.yard.store, NAME)
    assert told
    assert (told.status, told.running_digest, told.is_up) == ("InSync", new.digest, False)

    monkeypatch.setattr("tasks.deploy.robot.launch._LONGEST_PAUSE_S", 0.01)
    one.yard.store.put(bundle_key(new.digest), kept)
    eventually(lambda: bool(one.robot.supervise() or one.programs))
    eventually(
        lambda: one.robot.supervise() or read_reported(one.yard.store, NAME) == told.model_copy(update={"is_up": True})
    )


def test_what_lies_there_stays_while_the_store_cannot_give_another(one: OneRobot) -> None:
    version = one.yard.publish(GOOD)
    one.deploy(version, 1, timeout_s=0.0)
    one.robot.end()
    script = _changed(one, version.digest)
    changed = script.read_text()
    (one.root / "archives" / version.digest).unlink()
    one.yard.store.delete(bundle_key(version.digest))
    one.restarted().recover()
    assert (one.programs, script.read_text()) == ([], changed)


def test_a_robot_without_archives_runs_what_its_digest_says_while_the_store_is_away(one: OneRobot) -> None:
    version = one.yard.publish(GOOD)
    one.deploy(version, 1)
    one.robot.end()
    archive = one.root / "archives" / version.digest
    archive.unlink()
    one.yard.store.delete(bundle_key(version.digest))
    one.restarted().recover()
    eventually(lambda: one.programs == ["sleep 1000"])
    assert hashlib.sha256(archive.read_bytes()).hexdigest() == version.digest


def test_a_disk_that_cannot_be_read_ends_no_agent(one: OneRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreadable(_path: Path) -> str:
        raise OSError(errno.EIO, "Input/output error")

    version = one.yard.publish(GOOD)
    one.deploy(version, 1)
    one.robot.end()
    _changed(one, version.digest)
    monkeypatch.setattr("tasks.deploy.robot.install.digest_of", unreadable)
    one.restarted().recover()
    one.robot.supervise()
    assert one.programs == []
