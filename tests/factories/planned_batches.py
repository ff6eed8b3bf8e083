"""Batches without a simulator: plans, requests and rows made by hand."""

import hashlib
from collections.abc import Mapping
from typing import cast

from pydantic import JsonValue

from specs.data.episode import EpisodeResult, unfinished_result
from tasks.simulate.batch.batch_record import OpenBatch, load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkPart, Simulate
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tests.factories.episodes import collided, crashed, passed
from tests.factories.simulations import ROBOT, SCENARIO
from tests.factories.worlds import apartment

ROBOT_ARN = "arn:simyard:robot-application:0:courier"
SCENARIO_ARN = "arn:simyard:simulation-application:0:delivery"


def template(**changes: object) -> JobTemplate:
    """Returns a request that the matrix multiplies."""
    base = JobTemplate(robot=ROBOT, scenario=SCENARIO, environment={}, duration_s=60.0, failure_behavior="Fail")
    return base.model_copy(update=changes)


def plan(store: Store, **changes: object) -> BatchPlan:
    """Returns a plan of two worlds and three seeds, in chunks of four lanes; its worlds are in the store."""
    digests = {f"g/w{number}": put_world(store, f"g/w{number}") for number in range(2)}
    base = BatchPlan(
        templates=(template(),),
        worlds=tuple(digests),
        seeds=(0, 1, 2),
        sweep={},
        lanes=4,
        timeout_s=100.0,
        world_digests=digests,
        engine="auto",
    )
    return base.model_copy(update=changes)


def put_world(store: Store, reference: str) -> str:
    """Returns the digest of a world, having stored it."""
    generation, _, name = reference.partition("/")
    body = apartment(name=name).model_dump_json().encode()
    store.put(world_key(generation, name), body)
    return hashlib.sha256(body).hexdigest()


def request(made: BatchPlan) -> dict[str, JsonValue]:
    """Returns the document that a plan came from."""
    entries: list[JsonValue] = [
        {
            "maxJobDurationInSeconds": int(each.duration_s),
            "failureBehavior": each.failure_behavior,
            "robotApplications": [_use(ROBOT_ARN, "courier", "go_to_goal", each.environment)],
            "simulationApplications": [_use(SCENARIO_ARN, "delivery", "rooms", {})],
        }
        for each in made.templates
    ]
    return {"createSimulationJobRequests": entries, "batchPolicy": {"maxConcurrency": made.lanes}}


def _use(application: str, package: str, launch_file: str, environment: Mapping[str, str]) -> dict[str, JsonValue]:
    launch: dict[str, JsonValue] = {"packageName": package, "launchFile": launch_file}
    if environment:
        launch["environmentVariables"] = cast("JsonValue", dict(environment))
    return {"application": application, "launchConfig": launch}


def begun(store: Store, made: BatchPlan | None = None, name: str = "tok") -> OpenBatch:
    """Returns a batch in progress."""
    made = made or plan(store)
    return load_batch(store, open_batch(store, made, request(made), name).id)


def all_pass(part: ChunkPart) -> list[EpisodeResult]:
    """Simulates episodes that all pass."""
    part.watch()
    return [passed(each.index) for each in part.chunk.requests]


def mixed(part: ChunkPart) -> list[EpisodeResult]:
    """Simulates episodes of which some collide, and the last of each chunk crashes."""
    made = [(collided if each.index % 2 else passed)(each.index) for each in part.chunk.requests]
    return [*made[:-1], crashed(made[-1].index)]


def stops_after(first: int) -> Simulate:
    """Returns a simulation that does the first episodes of a chunk, and the others if nobody says stop."""

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        stopped = part.watch()
        return [
            unfinished_result(each.index, "Canceled", failure_code="", failure_reason="stopped before its end")
            if stopped and position >= first
            else passed(each.index)
            for position, each in enumerate(part.chunk.requests)
        ]

    return simulate
