"""docs/guide/policies.md: its files make one network three times, which drives robots to the same outcomes."""

import importlib.util
import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import COURIER, FOLDERS, REPOSITORY, SCENARIO, cluttered, simulate_lanes

logger = logging.getLogger(__name__)
FILES = re.compile(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", re.DOTALL)
EPISODES = 256
WORLDS: dict[str, World] = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(8)}
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("documented")
    for name, text in FILES.findall((REPOSITORY / "docs/guide/policies.md").read_text()):
        path: Path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "mine/robot.xml").write_bytes((FOLDERS[COURIER] / "robot.xml").read_bytes())
    subprocess.run([sys.executable, "make_policy.py"], cwd=folder, check=True)
    return folder / "mine"


def driven(bundle: Path, launch_file: str) -> list[EpisodeResult]:
    robot = ApplicationLaunch(name="mine", version="1", digest="4" * 64, package="nav", launch_file=launch_file)
    requests = [
        EpisodeRequest(
            index=number,
            world=f"hand/apartment-{number % len(WORLDS)}",
            seed=number,
            robot=robot,
            scenario=SCENARIO,
            environment={},
            duration_s=20.0,
        )
        for number in range(EPISODES)
    ]
    (chunk,) = plan_chunks(requests, EPISODES)
    return simulate_lanes(chunk, WORLDS, {**FOLDERS, robot.digest: bundle}, lanes=EPISODES, should_stop=lambda: False)


@pytest.fixture(scope="module")
def fused(bundle: Path) -> list[EpisodeResult]:
    return driven(bundle, "fused")


def flips(one: list[EpisodeResult], other: list[EpisodeResult]) -> int:
    """Returns how many outcomes differ, and tells it with how far apart the robots ended."""
    flipped = sum(
        (a.outcome_reason, a.goals_reached) != (b.outcome_reason, b.goals_reached)
        for a, b in zip(one, other, strict=True)
    )
    apart_m = sorted(
        ((a.final_x_m - b.final_x_m) ** 2 + (a.final_y_m - b.final_y_m) ** 2) ** 0.5
        for a, b in zip(one, other, strict=True)
    )
    logger.info(
        "%d of %d flipped; median %.2g m, most %.2g m apart", flipped, len(one), apart_m[len(one) // 2], apart_m[-1]
    )
    return flipped


def test_its_episodes_end_in_several_ways(fused: list[EpisodeResult]):
    assert {row.failure_reason for row in fused} == {""}
    assert {"collision", "timeout"} <= {row.outcome_reason for row in fused}
    assert sum(row.goals_reached for row in fused) > EPISODES // 20


def test_the_network_in_onnx_has_the_outcomes_of_the_network_in_jax(bundle: Path, fused: list[EpisodeResult]):
    assert flips(driven(bundle, "policy.onnx"), fused) <= EPISODES // 100


def test_the_network_in_torch_has_them_too(bundle: Path, fused: list[EpisodeResult]):
    if importlib.util.find_spec("torch") is None:
        pytest.skip("torch is not installed: it is no part of Simyard")
    assert flips(driven(bundle, "in_torch"), fused) <= EPISODES // 100
