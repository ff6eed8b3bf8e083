"""The stage that rolls a tested version out to a fleet, in waves."""

from flows.document.references import deployed_version, numbered_finder
from flows.stage.orchestrator import run_step
from flows.stage.stage_run import run_stage
from specs.digest import canonical_document
from specs.field_types import Architecture
from specs.pipeline.section_requests import deployment_request
from specs.pipeline.simulation_section import Deployment
from tasks.deploy.step import roll_out, section_signer
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id


def deployment_sync(
    spec: Deployment,
    store: str | None = None,
    tested: dict[str, str] | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    builds: dict[Architecture, str] | None = None,
) -> JobRecord:
    """Returns the deployment job; see the flow `flows.deployment_sync.deployment_sync`."""
    opened = open_store(store)
    section_signer(opened, spec)  # refuses a document whose keys are not here, before anything is recorded
    version = deployed_version(spec, opened, numbered_finder(opened, versions), tested)

    def work(given: str) -> JobRecord:
        request = deployment_request(spec, store_id=store_id(opened), version=str(version.number), token=given)
        shipped = version.digests if builds is None else builds
        job_token = request.clientRequestToken
        return run_step(roll_out, opened.url, request, spec, digest=version.digest, builds=shipped, token=job_token)

    identity = {"spec": canonical_document(spec), "digest": version.digest}
    return run_stage(opened, "deployment-sync", identity, token, work)
