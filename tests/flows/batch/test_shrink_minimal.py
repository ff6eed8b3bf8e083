"""A real robot's failure in a generated apartment, shrunk: of what is left every single piece is needed."""

import pytest

from flows.batch.replay_episode import bundles
from flows.batch.shrink import shrink_job
from specs.data.episode import ApplicationLaunch, reason
from specs.template.body import TemplateBody
from tasks.applications.registry import publish_bundle
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.replay.smallest_case import Trial, is_same_failure, simulate_trials
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store
from tasks.worlds.certificate import keep_furniture
from tasks.worlds.generate import generate_world
from tests.factories.batches import closed_batch, pushing_plan
from tests.repository import ROOT

# The courier with slipping wheels runs into furniture there with four of these seeds. Which ones it is changes with
# any last bit of its sensors.
FLOORPLAN, SEEDS = 3, range(48)


@pytest.mark.long
def test_without_any_single_piece_that_is_left_the_same_failure_is_gone(file_store: Store):
    body = (ROOT / "examples/templates/two-rooms.json").read_bytes()
    template = TemplateBody.model_validate_json(body)
    world = generate_world(template, seed=7, generation="wgj-1", floorplan_index=FLOORPLAN, interior_index=1)
    file_store.put(template_key(world.template_digest), body)
    robot = publish_bundle(file_store, "robot-application", "courier", ROOT / "applications/courier")
    plan = pushing_plan(file_store, worlds={"wgj-1/world": world}, seeds=tuple(SEEDS), lanes=len(SEEDS))
    launch = ApplicationLaunch(
        name="courier", version="1", digest=robot.digest, package="courier", launch_file="go_to_goal"
    )
    courier = plan.templates[0].model_copy(
        update={"robot": launch, "environment": {"ODOMETRY_SIGMA": "0.5"}, "duration_s": 10.0}
    )
    batch = closed_batch(file_store, plan.model_copy(update={"templates": (courier,)}))

    rows = committed_chunk(file_store, batch.id, 0) or []
    collision = next(row.index for row in rows if reason(row) == "collision")

    found = shrink_job(file_store, f"{batch.id}/{collision}", 400)
    assert (found.reason, found.same, found.minimal) == ("collision", True, True)
    pieces = tuple(piece.name for piece in found.small_world.furniture)
    assert 0 < len(pieces) < len(world.furniture)
    fewer = [keep_furniture(found.small_world, {*pieces} - {out}, template) for out in pieces]
    trials = [Trial(each, found.small_request.seed) for each in (found.small_world, *fewer)]
    small, *others = simulate_trials(batch, found.request, trials, bundles(batch))
    assert is_same_failure(found.ending, small)
    assert [is_same_failure(found.ending, each) for each in others] == [False] * len(pieces)
