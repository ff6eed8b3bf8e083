"""The clock of calls, for the process that watches."""

import py_compile
import sys
from mmap import mmap
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from tasks.simulate.application import bundle_code
from tasks.simulate.application.bundle_code import (
    CLOCK_BYTES,
    BundleCrash,
    CallWatchdog,
    call_bundle,
    load_factory,
    running_call,
)
from tasks.simulate.sandbox.simulator import timeout_of
from tests.factories.simulations import FAULTY, FOLDERS, PUSHER


def test_the_clock_of_a_call_stands_still_while_nodes_work(monkeypatch: pytest.MonkeyPatch):
    now_s = [100.0]
    monkeypatch.setattr(bundle_code.time, "monotonic", lambda: now_s[0])
    memory = mmap(-1, CLOCK_BYTES)
    clock = CallWatchdog(memory)
    with clock.call("slice", "", "a slice"):
        now_s[0] += 1.0
        with clock.call("nodes", "RobotApplicationCrash", "a control step"):
            now_s[0] += 50.0
            nodes = running_call(memory)
        now_s[0] += 2.0
        whole = running_call(memory)
    assert nodes is not None
    assert whole is not None
    assert [(each.kind, each.seconds) for each in (nodes, whole)] == [("nodes", 50.0), ("slice", 3.0)]
    assert running_call(memory) is None


def test_nodes_have_a_limit_of_their_own():
    memory = mmap(-1, CLOCK_BYTES)
    with CallWatchdog(memory).call("nodes", "RobotApplicationCrash", "a control step of 8 ROS applications"):
        call = running_call(memory)
    assert call is not None
    assert timeout_of(call._replace(seconds=400.0)) == ""
    assert "a control step of 8 ROS applications took longer than 900 s" in timeout_of(call._replace(seconds=901.0))


def launch(digest: str, launch_file: str = "drive") -> ApplicationLaunch:
    return ApplicationLaunch(name="app", version="1", digest=digest, package="pack", launch_file=launch_file)


def bundle(folder: Path, answer: int) -> Path:
    (folder / "pack").mkdir(parents=True)
    (folder / "pack" / "number.py").write_text(f"ANSWER = {answer}\n")
    (folder / "pack" / "drive.py").write_text(
        "from .number import ANSWER\n\n\ndef controller(environment):\n    return ANSWER\n"
    )
    return folder


def test_two_versions_of_an_application_live_side_by_side(tmp_path: Path):
    one, two = bundle(tmp_path / "one", 1), bundle(tmp_path / "two", 2)
    first = load_factory(one, launch("1" * 64), "controller", "RobotApplicationCrash")
    second = load_factory(two, launch("2" * 64), "controller", "RobotApplicationCrash")
    assert (first({}), second({})) == (1, 2)
    assert "pack" not in sys.modules


def forge(folder: Path, place: str) -> None:
    """Compiles another answer where Python looks for the bytecode of a module, to be taken whatever its source."""
    other = folder / "other.py"
    other.write_text("ANSWER = 666\n")
    target = folder / "pack" / place
    py_compile.compile(str(other), cfile=str(target), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    other.unlink()


def test_bytecode_in_a_bundle_is_not_run_in_place_of_its_source(tmp_path: Path):
    folder = bundle(tmp_path / "app", 1)
    forge(folder, f"__pycache__/number.{sys.implementation.cache_tag}.pyc")
    assert load_factory(folder, launch("8" * 64), "controller", "RobotApplicationCrash")({}) == 1


def test_bytecode_without_a_source_is_no_module(tmp_path: Path):
    folder = bundle(tmp_path / "app", 1)
    forge(folder, "number.pyc")
    (folder / "pack" / "number.py").unlink()
    with pytest.raises(BundleCrash, match=r"No module named 'pack\.number'"):
        load_factory(folder, launch("9" * 64), "controller", "RobotApplicationCrash")


def test_importing_a_bundle_writes_nothing_into_it(tmp_path: Path):
    folder = bundle(tmp_path / "app", 1)
    before = sorted(folder.rglob("*"))
    load_factory(folder, launch("a" * 64), "controller", "RobotApplicationCrash")
    assert sorted(folder.rglob("*")) == before


def test_a_bundle_that_does_not_import_says_what_is_missing():
    with pytest.raises(BundleCrash, match="a_library_that_nobody_has") as caught:
        load_factory(
            FOLDERS[FAULTY],
            PUSHER.model_copy(update={"launch_file": "unimportable"}),
            "controller",
            "RobotApplicationCrash",
        )
    assert caught.value.code == "RobotApplicationCrash"


def test_a_missing_launch_file_is_named(tmp_path: Path):
    with pytest.raises(BundleCrash, match=r"pack/absent\.py"):
        load_factory(bundle(tmp_path / "app", 1), launch("3" * 64, "absent"), "scenario", "SimulationApplicationCrash")


def test_a_module_without_the_function_says_which(tmp_path: Path):
    with pytest.raises(BundleCrash, match=r"defines no function scenario\(environment\)"):
        load_factory(bundle(tmp_path / "app", 1), launch("4" * 64), "scenario", "SimulationApplicationCrash")


def test_a_crash_is_told_in_one_line_with_the_authors_own_module_names(tmp_path: Path):
    folder = bundle(tmp_path / "torn", 1)
    (folder / "pack" / "drive.py").write_text("raise ValueError('first line\\n  ' + __name__)\n")
    with pytest.raises(BundleCrash) as crash:
        load_factory(folder, launch("7" * 64), "controller", "RobotApplicationCrash")
    place = r"(pack/drive.py, line 1: raise ValueError('first line\n ' + __name__))"
    assert crash.value.reason.endswith(f"ValueError: first line pack.drive {place}")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("raise ValueError('no #1') # noqa: TRY004 - our reason", "raise ValueError('no #1')"),
        ("raise ValueError( # why", "raise ValueError( # why"),  # the line alone is no statement
    ],
)
def test_a_crash_shows_its_line_without_the_comment(tmp_path: Path, line: str, told: str):
    folder = bundle(tmp_path / "noted", 1)
    closed = ")" if line.endswith("why") else ""
    (folder / "pack" / "drive.py").write_text(f"{line}\n{closed}\n")
    with pytest.raises(BundleCrash) as crash:
        load_factory(folder, launch(f"{len(line):064x}"), "controller", "RobotApplicationCrash")
    assert crash.value.reason.endswith(f"(pack/drive.py, line 1: {told})")


def crashed(folder: Path, source: str, digest: str) -> str:
    """Returns why an application crashes when it is imported and its controller is made."""
    bundle(folder, 1)
    (folder / "pack" / "drive.py").write_text(source)
    try:
        made = load_factory(folder, launch(digest * 64), "controller", "RobotApplicationCrash")
        call_bundle("RobotApplicationCrash", "controller(environment)", made, {})
    except BundleCrash as crash:
        return crash.reason
    return "nothing"


def test_a_syntax_error_has_the_file_in_the_bundle_and_the_line(tmp_path: Path):
    reason = crashed(tmp_path / "app", "x = 1\ndef controller(environment)\n", "b")
    assert reason.endswith("SyntaxError: expected ':' (pack/drive.py, line 2: def controller(environment))")


@pytest.mark.parametrize(
    ("digest", "raising", "remedy"),
    [
        (
            "f",
            "class TracerBoolConversionError(Exception): ...\n    raise TracerBoolConversionError",
            "write jax = False into",
        ),
        ("0", "return object().init", "and no init, is plain Python: write jax = False into its module"),
        ("6", "return min([])", "declares no lidar, as in lidar = Lidar()"),
    ],
)
def test_what_an_author_forgot_is_said(tmp_path: Path, digest: str, raising: str, remedy: str):
    reason = crashed(tmp_path / "app", f"def controller(environment):\n    {raising}\n", digest)
    assert "(pack/drive.py, line " in reason
    assert remedy in reason


def test_what_an_author_forgot_is_said_where_no_line_is_to_blame():
    with pytest.raises(BundleCrash) as caught:
        call_bundle("RobotApplicationCrash", "controller.init", getattr, object(), "init")
    assert "has no attribute 'init': a controller that has reset, and no init, is plain" in caught.value.reason


def test_an_import_that_fails_tells_no_folder_of_this_machine(tmp_path: Path):
    reason = crashed(tmp_path / "app", "from .number import NOTHING\n", "c")
    assert str(tmp_path) not in reason
    assert reason.endswith("(pack/drive.py, line 1: from .number import NOTHING)")


def test_a_long_message_does_not_push_the_place_out(tmp_path: Path):
    reason = crashed(tmp_path / "app", "def controller(environment):\n    return environment['x' * 5000]\n", "d")
    assert reason.endswith("xxx (pack/drive.py, line 2: return environment['x' * 5000])")
    assert len(reason) == 1000


def test_a_long_line_is_cut(tmp_path: Path):
    reason = crashed(tmp_path / "app", f"def controller(environment):\n    return {{}}['{'y' * 3000}']\n", "e")
    assert reason.endswith("yyy...)")
    assert "(pack/drive.py, line 2: return {}['yyy" in reason


def test_half_a_character_in_a_message_can_be_written_down():
    def fail() -> None:
        raise ValueError("no file named \udce9t\xe9")

    with pytest.raises(BundleCrash) as crash:
        call_bundle("RobotApplicationCrash", "controller", fail)
    assert "no file named ?t\xe9" in crash.value.reason.encode().decode()
