"""Applications' modules are imported each by itself."""

import sys
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from tasks.simulate.application.code import BundleCrash, load_factory
from tests.factories.simulations import FAULTY, FOLDERS, PUSHER


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
    assert crash.value.reason.endswith("ValueError: first line pack.drive (pack/drive.py, line 1)")
