"""A store with one of everything that the pages of a browser show, each text in it an attack if asked for."""

import json
import time
from typing import NamedTuple

from pydantic import JsonValue

from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.fleet.states import Reported
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_store import commit
from tasks.storage.base.keys import (
    application_key,
    contact_sheet_key,
    desired_key,
    reported_key,
    template_key,
    world_key,
)
from tasks.storage.base.store import Store, encode_document
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import advance, submit
from tests.deploy.yard import desired_state
from tests.factories.episodes import collided, passed
from tests.factories.planned_batches import begun, plan, template
from tests.factories.worlds import apartment

ATTACK = "<script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
GOOD = "plain"
REPORT = b"""<!doctype html><title>report</title><script>document.title='owned'</script><p>A report</p>
<a href=/batches>All</a><img src=/fleets><form action=/sign-out method=post><button>Leave</button></form>"""
SHEET = (
    b'<svg xmlns="http://www.w3.org/2000/svg" width="40" height="30"><script>alert(1)</script><rect width="9"/></svg>'
)
DIGEST = "a" * 64
Document = dict[str, JsonValue]


class Shown(NamedTuple):
    """The addresses of the pages of a store, and what is behind them."""

    batch: str
    run: str
    generation: str
    export: str
    deployment: str

    @property
    def pages(self) -> tuple[str, ...]:
        """Every kind of page."""
        lists = ("runs", "batches", "worlds", "generations", "exports", "templates", "applications")
        return (
            "/",
            *(f"/{each}" for each in (*lists, "fleets", "robots", "deployments")),
            f"/runs/{self.run}",
            f"/batches/{self.batch}",
            f"/batches/{self.batch}/jobs/0",
            f"/generations/{self.generation}",
            f"/worlds/{self.generation}/world-1-1",
            f"/exports/{self.export}",
            "/templates/rooms",
            "/applications/robot/courier",
            "/fleets/home",
            "/robots/r1",
            f"/deployments/{self.deployment}",
        )


def shown_store(store: Store, text: str = GOOD) -> Shown:
    """Returns what a store has now: one of everything, with the text wherever anybody's text may stand."""
    run = _run(store, text)
    batch = _batch(store, f"{run}-batch", text)
    generation, export = _worlds(store, text)
    deployment = _fleet(store, text)
    for kind, name in (("robot-application", "courier"), ("simulation-application", "delivery")):
        version = {"kind": kind, "name": name, "number": 1, "digest": DIGEST, "size_bytes": 9, "created_at_s": 1e9}
        store.put(application_key(kind, name), json.dumps({"kind": kind, "name": name, "versions": [version]}).encode())
    store.put(template_key("rooms"), json.dumps({"version": "2", "name": text}).encode())
    return Shown(batch.id, run, generation, export, deployment)


def _run(store: Store, text: str) -> str:
    identity: Document = {"flow": "pipeline", "spec": {"name": text, "simulationBatch": {}}}
    run = submit(store, "pipeline-run", identity, "run-token")
    gate: Document = {"name": "gate", "arn": "", "status": "PASS", "summary": text, "seconds": 1.0}
    report: Document = {"run": run.id, "name": text, "verdict": "PASS", "stages": [gate]}
    flow_run = "0a1b2c3d-0000-4000-8000-000000000000"
    advance(store, "pipeline-run", run.id, "Completed", detail={"report": report, "flow_run": flow_run})
    return run.id


def _batch(store: Store, token: str, text: str) -> OpenBatch:
    batch = begun(store, plan(store, templates=(template(environment={"NAME": text}),)), token)
    chunk = batch.layout.chunk(0)
    rows = [collided(each.index) if each.index % 2 else passed(each.index) for each in chunk.requests]
    failed = rows[1].model_copy(update={"failure_reason": text, "rooms_entered": (text,), "rooms_total": 2})
    commit(store, batch.id, 0, [rows[0], failed, *rows[2:]], batch.authenticator)
    why: list[JsonValue] = [{"reason": "collision", "episodes": 2, "sample": text}]
    detail: Document = {"passed": 4, "episodes": 6, "report_url": f"{store.url}/x", "why_not": why}
    advance(store, "simulation-job-batch", batch.id, "InProgress", detail=detail)
    bucket = open_bucket(store, "results")
    bucket.put(f"{batch.id}/report.html", REPORT)
    bucket.put(f"{batch.id}/results.parquet", b"PAR1")
    if text == GOOD:
        bucket.put(f"trends/{text}.html", REPORT)
    return batch


def _worlds(store: Store, text: str) -> tuple[str, str]:
    request: Document = {
        "template": "arn:simyard:world-template:0:rooms",
        "worldCount": {"floorplanCount": 1},
        "tags": {"a": text},
    }
    generation = submit(store, "world-generation-job", request, "worlds-token")
    world = apartment(generation=generation.id, room_names=(text, "Kitchen"), unmet=(text,))
    store.put(world_key(generation.id, "world-1-1"), world.model_dump_json().encode())
    store.put(contact_sheet_key(generation.id), SHEET)
    failures: Document = {
        "InternalServiceError": {"count": 1, "sample_reason": f"{text} {store.url}/worlds/secret.json"}
    }
    detail: Document = {"worlds": [f"{generation.id}/world-1-1"], "failures": failures, "seed": 3}
    advance(store, "world-generation-job", generation.id, "PartialFailed", failure_reason=text, detail=detail)
    place: Document = {"s3Bucket": "worlds", "s3Prefix": text}
    wanted: Document = {
        "worlds": [f"arn:simyard:world:0:{generation.id}/world-1-1"],
        "outputLocation": place,
        "formats": ["svg"],
    }
    export = submit(store, "world-export-job", wanted, "export-token")
    advance(store, "world-export-job", export.id, "Failed", failure_code="InternalServiceError", failure_reason=text)
    return generation.id, export.id


def _fleet(store: Store, text: str) -> str:
    create_fleet(store, "home", {"place": text})
    for name in ("r1", "r2"):
        create_robot(store, name, tags={"owner": text})
        register_robot(store, "home", name)
    config: Document = {
        "application": "arn:simyard:robot-application:0:courier",
        "applicationVersion": "1",
        "launchConfig": {"packageName": "courier", "launchFile": "run.sh"},
    }
    request: Document = {
        "clientRequestToken": "deployment-token",
        "fleet": "arn:simyard:deployment-fleet:0:home",
        "deploymentApplicationConfigs": [config],
    }
    deployment = submit(store, "deployment-job", request, "deployment-token")
    progress: Document = {"status": "Failed", "step": "Launching", "failure_reason": text, "started_at_s": 1e9}
    detail: Document = {"progress": {"r1": progress}, "trust": text}
    advance(store, "deployment-job", deployment.id, "Failed", failure_reason=text, detail=detail)
    desired = desired_state(deployment=deployment.id, digest=DIGEST, issued_at_s=time.time())
    reported = Reported(
        robot="r1",
        deployment=deployment.id,
        sequence=1,
        boot_id="1",
        status="Failed",
        step="Launching",
        failure_code="PreLaunchFileFailure",
        failure_reason=text,
        running_digest=DIGEST,
        started_at_s=time.time(),
    )
    store.put(desired_key("r1"), encode_document(desired))
    store.put(reported_key("r1"), encode_document(reported))
    return deployment.id
