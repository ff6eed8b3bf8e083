"""What `simyard plan` says of a batch: counted, without JAX, from what this machine took before."""

import subprocess
import sys
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.engines.engine_table import EngineChoice
from tasks.simulate.forecast import forecast
from tasks.simulate.forecast.batch_times import BatchTiming, remember_batch
from tasks.simulate.forecast.forecast import EngineAnswer, engine_plan, recall_choice
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.episode_layout import Layout
from tests.factories.planned_batches import template
from tests.factories.simulations import FOLDERS, PUSHER


@pytest.fixture(autouse=True)
def no_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gives each test a cache folder of its own, without timings."""
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def plan(*, seeds: int = 4, robot: ApplicationLaunch | None = None, **changes: object) -> BatchPlan:
    base = BatchPlan(
        templates=(template(robot=robot) if robot else template(),),
        worlds=tuple(f"w/{number}" for number in range(5)),
        seeds=tuple(range(seeds)),
        sweep={"MAX_SPEED": ("0.3", "0.6")},
        lanes=16,
        timeout_s=1.0,
        world_digests={},
        engine="auto",
    )
    return base.model_copy(update=changes)


TOOK = BatchTiming(
    episodes=40,
    worlds=5,
    before_s=8.0,
    worlds_s=2.0,
    once_s=0.0,
    chunks_s=30.0,
    compile_s=1.0,
    after_s=2.0,
    audit_compile_s=0.0,
    peak_bytes=3 << 30,
)


def test_worlds_seeds_and_numbers_add_no_compilation():
    found = engine_plan(plan(), FOLDERS)
    assert (found.episodes, found.compilations, found.chunks, found.lanes) == (40, 1, 3, 16)
    assert found.lane_steps_at_most == 40 * 60 * 200


def test_each_text_is_a_program():
    assert engine_plan(plan(sweep={"MODE": ("careful", "bold")}), FOLDERS).compilations == 2


def test_the_engine_is_told_with_its_reason():
    (robot,) = engine_plan(plan(), FOLDERS).robots
    assert robot.choice
    assert (robot.robot, robot.choice.engine, robot.choice.why) == ("courier", "planar", "the fastest of all")
    (robot,) = engine_plan(plan(engine="mujoco"), FOLDERS).robots
    assert robot.choice
    assert (robot.choice.engine, robot.choice.why) == ("mujoco", "asked for")


def test_a_robot_that_no_engine_takes_is_told_with_the_remedy(tmp_path: Path):
    (tmp_path / "robot.xml").write_text("<mujoco><worldbody/></mujoco>")
    asked = plan(robot=PUSHER)
    found = engine_plan(asked, {**FOLDERS, PUSHER.digest: tmp_path})
    (robot,) = found.robots
    assert robot.choice is None
    assert "robot.xml" in robot.refusal
    assert found.audited == 0


def test_a_hundred_thousand_episodes_are_counted_and_not_listed(monkeypatch: pytest.MonkeyPatch):
    def listed(*_: object) -> object:
        pytest.fail("listed")

    monkeypatch.setattr(Layout, "requests", listed)
    found = engine_plan(plan(seeds=10_000, lanes=256), FOLDERS)
    assert (found.episodes, found.chunks) == (100_000, 391)
    assert found.wall_s.high > 100.0


def test_what_the_last_batch_of_these_programs_took_is_what_is_predicted():
    remember_batch(plan(audit=0), TOOK)
    found = engine_plan(plan(audit=0), FOLDERS)
    assert found.known
    assert found.wall_s.low < 40.0 < found.wall_s.high < 2.0 * found.wall_s.low
    assert found.memory_bytes.low < 3 << 30 < found.memory_bytes.high


def test_of_other_programs_only_a_range_is_told():
    remember_batch(plan(audit=0), TOOK)
    found = engine_plan(plan(), FOLDERS)
    assert not found.known
    assert 0.0 < 2.0 * found.wall_s.low < found.wall_s.high
    assert 0.0 < 2.0 * found.memory_bytes.low < found.memory_bytes.high


def test_an_audit_and_more_episodes_take_longer():
    small, large = engine_plan(plan(audit=0), FOLDERS), engine_plan(plan(audit=0, seeds=40), FOLDERS)
    audited = engine_plan(plan(), FOLDERS)
    assert small.wall_s.high < large.wall_s.high
    assert small.wall_s.low < large.wall_s.low
    assert small.wall_s.low < audited.wall_s.low
    assert audited.audited == 32


def test_planning_imports_no_jax():
    modules = ", ".join(f"tasks.simulate.{name}" for name in ("plan.chunks", "devices", "forecast.forecast"))
    subprocess.run([sys.executable, "-c", f"import sys, {modules}; assert 'jax' not in sys.modules"], check=True)


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
