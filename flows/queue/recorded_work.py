"""The work of a job that the gateway has recorded: from its record alone, through the stages that a document's has.

What the gateway writes, and a worker takes, is this. First the entry of the queue (`tasks.storage.jobs.queue.enqueue`),
then the record (`tasks.storage.jobs.records.submit`), Pending, under the request's clientRequestToken, or one that the
gateway has chosen. The record's ``request`` is

- of a world-generation-job: RoboMaker's request as `specs.digest.canonical_document` has it, its ``template`` an ARN,
  its ``clientRequestToken`` the token; and beside its fields ``seed`` and ``templateDigest``. The template's body lies
  under ``tasks.storage.base.keys.template_key(templateDigest)`` before the record does.
- of a world-export-job: likewise RoboMaker's request, and beside it ``formats``, sorted, each once.
- of a simulation-job-batch: ``{"request": ..., "plan": ...}``, as `tasks.simulate.batch.job.open_batch` submits them:
  RoboMaker's request of a batch, or of a single job, and ``BatchPlan.model_dump(mode="json")``.
- of a deployment-job: RoboMaker's request as `canonical_document` has it, its ``clientRequestToken`` the token, and its
  ``applicationVersion`` a number, so that what was checked is what is deployed. The fleet's record names the job as its
  deployment. Of a sync, the entry's options are ``{"sync": true}``, and the request is what
  `tasks.deploy.rollout.sync.sync_request` makes of the last deployment.

A token stands for its record's digest. So what is submitted again here, by the functions that a document's stage calls,
must be what was recorded: `canonical_document` of the request that was read back is.
"""

from collections.abc import Mapping

from pydantic import JsonValue, TypeAdapter

from flows.batch.batch_end import close_if_stopped
from flows.stage.batch_stage import run_batch
from flows.stage.orchestrator import run_step
from specs.data.world import ROBOT_RADIUS_M
from specs.errors import StageFailed
from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.world_jobs import CreateWorldExportJobRequest, CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.applications.registry import resolve
from tasks.deploy.rollout.sync import SYNC
from tasks.deploy.step import deploy_version, sync_fleet
from tasks.export.step import draw_worlds, export_worlds
from tasks.simulate.batch.job import STOPPING
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.encoding import decode_document
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance
from tasks.worlds.step import generate_worlds

_SEED, _TEMPLATE, _RADIUS, _FORMATS = "seed", "templateDigest", "robotRadius", "formats"
_WORLD_FORMATS = TypeAdapter(tuple[WorldFormat, ...])
_MADE = frozenset({"Completed", "PartialFailed"})


def work_off(store: Store, record: JobRecord, options: Mapping[str, JsonValue]) -> JobRecord:
    """Returns the job's record in its terminal state; one that was begun and left is continued.

    Args:
        store: Where the job is.
        record: The job's.
        options: Of its entry in the queue.

    Raises:
        SimyardError: It cannot be done, or not now.
    """
    match record.kind:
        case "world-generation-job":
            return _generate(store, record)
        case "world-export-job":
            return _export(store, record)
        case "simulation-job-batch":
            return _simulate(store, record)
        case "deployment-job":
            return _sync(store, record) if options.get(SYNC) else _deploy(store, record)
        case "pipeline-run":
            raise StageFailed("InvalidInput", "a run of a document is not queued", record.arn)


def _generate(store: Store, record: JobRecord) -> JobRecord:
    own = record.request
    key = template_key(str(own[_TEMPLATE]))
    made = run_step(
        generate_worlds,
        store.url,
        CreateWorldGenerationJobRequest.model_validate(_without(own, _SEED, _TEMPLATE, _RADIUS)),
        decode_document(TemplateBody, store.get(key), store, key),
        seed=int(str(own[_SEED])),
        token=record.token,
        robot_radius_m=float(str(own.get(_RADIUS, ROBOT_RADIUS_M))),
    )
    if made.status in _MADE:
        run_step(draw_worlds, store.url, made)
    return made


def _export(store: Store, record: JobRecord) -> JobRecord:
    request = CreateWorldExportJobRequest.model_validate(_without(record.request, _FORMATS))
    formats = _WORLD_FORMATS.validate_python(record.request[_FORMATS])
    return run_step(export_worlds, store.url, request, formats=formats, token=record.token)


def _simulate(store: Store, record: JobRecord) -> JobRecord:
    begun = advance(store, "simulation-job-batch", record.id, "InProgress", only_from={"Pending"})
    if begun.status in STOPPING:
        return close_if_stopped(store, record.id)
    return run_batch(store, record.id, recorded_location(record))


def _deploy(store: Store, record: JobRecord) -> JobRecord:
    request = CreateDeploymentJobRequest.model_validate(record.request)
    asked = request.deploymentApplicationConfigs[0]
    version = resolve(store, "robot-application", asked.application, asked.applicationVersion)
    return run_step(deploy_version, store.url, request, digest=version.digest, token=record.token)


def _sync(store: Store, record: JobRecord) -> JobRecord:
    return run_step(sync_fleet, store.url, str(record.request["fleet"]), token=record.token)


def _without(document: Mapping[str, JsonValue], *names: str) -> dict[str, JsonValue]:
    return {name: value for name, value in document.items() if name not in names}
