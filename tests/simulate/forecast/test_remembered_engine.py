"""Which engine takes a robot is found out once for a bundle, and anew when the bundle or the code has changed."""

from pathlib import Path

import pytest

from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.engines.engine_table import EngineChoice
from tasks.simulate.forecast import forecast
from tasks.simulate.forecast.forecast import EngineAnswer, recall_choice

DIGEST = "d" * 64
CHOICE = EngineChoice(engine="planar", device="cpu", why="the fastest of all")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Returns for which engine a robot was loaded, each time that it was."""
    found: list[str] = []

    def choose(wanted: str, *_: object) -> EngineChoice:
        found.append(wanted)
        if wanted == "mjx":
            raise RobotRefused("a cylinder")
        return CHOICE

    monkeypatch.setattr(forecast, "choose_engine", choose)
    return found


def chosen(folder: Path, engine: str = "auto", digest: str = DIGEST) -> EngineAnswer:
    return recall_choice(engine, digest, folder / "robot.xml", "jax", "cpu")


def test_a_robot_is_loaded_once(tmp_path: Path, asked: list[str]):
    assert chosen(tmp_path) == chosen(tmp_path) == EngineAnswer(choice=CHOICE)
    assert asked == ["auto"]


def test_a_refusal_is_remembered_too(tmp_path: Path, asked: list[str]):
    assert chosen(tmp_path, "mjx") == chosen(tmp_path, "mjx") == EngineAnswer(choice=None, refusal="a cylinder")
    assert asked == ["mjx"]


def test_another_bundle_engine_or_file_is_looked_at_anew(tmp_path: Path, asked: list[str]):
    chosen(tmp_path)
    chosen(tmp_path, digest="e" * 64)
    chosen(tmp_path, "mjx")
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    chosen(tmp_path)
    assert asked == ["auto", "auto", "mjx", "auto"]


def test_other_code_looks_anew(tmp_path: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch):
    chosen(tmp_path)
    monkeypatch.setattr(forecast, "_code", lambda: ["another"])
    chosen(tmp_path)
    assert asked == ["auto", "auto"]


def test_what_cannot_be_read_is_no_memory(tmp_path: Path, asked: list[str], cache: Path):
    chosen(tmp_path)
    for file in (cache / "engines").iterdir():
        file.write_text("{")
    assert chosen(tmp_path).choice == CHOICE
    assert asked == ["auto", "auto"]


def test_a_folder_that_cannot_be_written_to_harms_nothing(tmp_path: Path, asked: list[str], cache: Path):
    cache.write_text("no folder")
    assert chosen(tmp_path).choice == CHOICE
