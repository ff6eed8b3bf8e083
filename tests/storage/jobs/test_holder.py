import subprocess
import sys

from tasks.storage.jobs.claim import ProcessIdentity, is_known_dead, this_process

_TELL = (
    "from tasks.storage.jobs.claim import this_process; print(this_process().model_dump_json(), flush=True); input()"
)


def _child() -> tuple[subprocess.Popen[str], ProcessIdentity]:
    child = subprocess.Popen([sys.executable, "-c", _TELL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    return child, ProcessIdentity.model_validate_json(child.stdout.readline())


def test_a_process_that_runs_is_not_dead() -> None:
    child, identity = _child()
    with child:
        assert not is_known_dead(identity)
        child.kill()


def test_a_killed_process_is_dead_before_and_after_its_parent_notices() -> None:
    child, identity = _child()
    with child:
        child.kill()
        while not is_known_dead(identity):  # the kernel takes a moment; nobody has waited for the child yet
            assert child.returncode is None
    assert is_known_dead(identity)


def test_a_later_process_with_the_same_number_is_not_mistaken() -> None:
    assert is_known_dead(this_process().model_copy(update={"started": "1"}))


def test_of_a_process_on_another_host_nothing_is_known() -> None:
    assert not is_known_dead(ProcessIdentity(host="elsewhere", pid=2**22 + 1, started="1"))


def test_of_a_process_that_could_not_tell_nothing_is_known() -> None:
    assert not is_known_dead(this_process().model_copy(update={"started": ""}))
