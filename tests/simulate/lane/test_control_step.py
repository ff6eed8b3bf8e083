"""What a control step makes of a lane, as far as the scenario is told."""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import pytest

from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.data.outcomes import OutcomeReason
from specs.data.world import World
from tasks.simulate.application.contract import REASONS, Motion, PeopleWork, Work
from tasks.simulate.lane.control_step import _whose
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import DRIFT, FAULTY, FOLDERS, pushing, simulate_lanes

LANES = 8
BOX = "b" * 64


@pytest.fixture(scope="module", params=["mujoco", pytest.param("mjx", marks=pytest.mark.soak)])
def rows(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, pens: dict[str, World]
) -> list[EpisodeResult]:
    """A long box, driven blindly among posts and blocks."""
    folder: Path = tmp_path_factory.mktemp("box")
    (folder / "faulty").symlink_to(FOLDERS[FAULTY] / "faulty")
    text = (FOLDERS[FAULTY] / "robot.xml").read_text()
    hull = '<geom name="body" type="box" size="0.3 0.08 0.1" mass="2"/>'
    start, end = text.index('<geom name="body"'), text.index("/>", text.index('<geom name="body"')) + 2
    (folder / "robot.xml").write_text(text[:start] + hull + text[end:])
    robot = ApplicationLaunch(name="box", version="1", digest=BOX, package="faulty", launch_file="pushing")
    asked = [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=2.0) for k in range(LANES)]
    requests = [each.model_copy(update={"robot": robot}) for each in asked]
    (chunk,) = plan_chunks(requests, LANES)
    bundles = {BOX: folder, DRIFT: FOLDERS[DRIFT]}
    return simulate_lanes(chunk, pens, bundles, lanes=LANES, engine=request.param, should_stop=lambda: False)


def test_the_clearance_of_a_hull_that_is_not_round_is_negative_in_contact_alone(rows: list[EpisodeResult]):
    assert {row.failure_reason for row in rows} == {""}
    free = [row.min_clearance_m for row in rows if not row.collisions]
    assert free
    assert min(free) >= 0.0
    assert all(row.min_clearance_m < 1e-3 for row in rows if row.collisions)


@pytest.mark.parametrize(
    ("solids_ns", "people_ns", "verdict", "becomes"),
    [
        (0.0, 0.3, "collision", "person"),
        (0.2, 0.3, "collision", "collision"),
        (0.2, 0.0, "collision", "collision"),
        (0.0, 0.3, "stuck", "stuck"),
    ],
)
def test_a_collision_in_which_people_alone_push_is_one_with_a_person(
    solids_ns: float, people_ns: float, verdict: OutcomeReason, becomes: OutcomeReason
):
    none: Any = None
    zero = jnp.zeros(())
    people = PeopleWork(jnp.float32(people_ns), zero)
    motion = Motion(none, Work(jnp.float32(solids_ns), jnp.zeros(2), zero), zero, people)
    assert REASONS[int(_whose(jnp.int32(REASONS.index(verdict)), motion))] == becomes


@pytest.mark.parametrize(("solids_ns", "becomes"), [(0.0, "robot"), (0.2, "collision")])
def test_a_collision_in_which_no_solid_pushes_but_a_robot_is_one_with_that(solids_ns: float, becomes: OutcomeReason):
    none: Any = None
    zero = jnp.zeros(())
    motion = Motion(none, Work(jnp.float32(solids_ns), jnp.zeros(2), zero), zero, robots_ns=jnp.float32(0.3))
    assert REASONS[int(_whose(jnp.int32(REASONS.index("collision")), motion))] == becomes
