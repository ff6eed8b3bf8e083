"""Batches that were really simulated and closed, as the flow leaves them, in seconds and without Prefect.

A robot that drives blindly in curves through pens full of posts, and is to reach goals: some of that ends in
collisions.
"""

import hashlib
import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from flows.batch.batch_end import RecordedEpisodes, close_with_tables
from flows.batch.replay_episode import bundles
from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.data.world import World
from specs.pipeline.simulation_section import Recordings
from tasks.applications.registry import publish_bundle
from tasks.simulate.audit.audit_run import write_audit
from tasks.simulate.batch.batch_record import OpenBatch, complete, load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.provenance import note_machine
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tests.factories.planned_batches import request
from tests.factories.simulations import BUNDLES, REPOSITORY, pen, simulate_lanes

LANES = 16
PENS: Mapping[str, World] = {f"hand/pen-{seed}": pen(4.5, seed) for seed in range(2)}
PUSHER, DELIVERY = BUNDLES / "faulty", REPOSITORY / "applications" / "delivery"


def put_worlds(store: Store, worlds: Mapping[str, World]) -> dict[str, str]:
    """Returns the digests of worlds, having stored them."""
    digests: dict[str, str] = {}
    for reference, world in worlds.items():
        generation, _, name = reference.partition("/")
        body = world.model_copy(update={"generation": generation, "name": name}).model_dump_json().encode()
        store.put(world_key(generation, name), body)
        digests[reference] = hashlib.sha256(body).hexdigest()
    return digests


def pushing_plan(
    store: Store, *, robot: Path = PUSHER, worlds: Mapping[str, World] = PENS, **changes: object
) -> BatchPlan:
    """Returns the plan of a batch of the pushing robot, its bundles and worlds stored."""
    digests = put_worlds(store, worlds)
    launched = publish_bundle(store, "robot-application", "pusher", robot)
    tested = publish_bundle(store, "simulation-application", "delivery", DELIVERY)
    base = BatchPlan(
        templates=(
            JobTemplate(
                robot=ApplicationLaunch(
                    name="pusher",
                    version=str(launched.number),
                    digest=launched.digest,
                    package="faulty",
                    launch_file="pushing",
                ),
                scenario=ApplicationLaunch(
                    name="delivery",
                    version=str(tested.number),
                    digest=tested.digest,
                    package="delivery",
                    launch_file="rooms",
                ),
                environment={"FAULT": "0", "GOALS": "1"},
                duration_s=8.0,
                failure_behavior="Fail",
            ),
        ),
        worlds=tuple(digests),
        seeds=tuple(range(16)),
        sweep={},
        lanes=LANES,
        timeout_s=600.0,
        world_digests=digests,
        engine="auto",
        recordings=Recordings(episodes="all", rateHz=4),
        audit=0,
    )
    return base.model_copy(update=changes)


def closed_batch(store: Store, plan: BatchPlan, name: str = "tok") -> OpenBatch:
    """Returns a batch of a plan, simulated to its end."""
    batch = load_batch(store, open_batch(store, plan, request(plan), name).id)
    note_machine(batch)
    folders = bundles(batch)
    episodes = RecordedEpisodes(batch, recorded_location(batch.record()), folders)
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, partial(_simulate, batch, folders), episodes.write, lanes=plan.lanes, left_s=3600.0)
    record = complete(batch)
    audit = partial(write_audit, batch, folders, recorded_location(record)) if plan.audit else dict
    close_with_tables(batch, audit)
    return batch


def slower_pusher(folder: Path) -> Path:
    """Returns another version of the pushing robot, made in a folder: it drives in other curves."""
    robot = shutil.copytree(PUSHER, folder / "slower")
    code = robot / "faulty" / "pushing.py"
    code.write_text(code.read_text().replace("jnp.float32(0.4)", "jnp.float32(0.25)"))
    return robot


def _simulate(batch: OpenBatch, folders: Mapping[str, Path], part: ChunkPart) -> list[EpisodeResult]:
    return simulate_lanes(
        part.chunk,
        part.worlds,
        folders,
        lanes=part.lanes,
        engine=batch.plan.engine,
        should_stop=part.watch,
        recorder=part.recorder,
    )
