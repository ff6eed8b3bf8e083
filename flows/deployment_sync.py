"""The flow `deployment-sync`: rolls a tested version out to a fleet, in waves."""

from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from urllib.parse import unquote

from prefect import flow

from flows.document.references import deployed_version, numbered_finder
from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.entry.secret_guard import guarded
from flows.run.cancellation import cancel_with_flow_run
from flows.run.stage_run import run_name, run_stage
from specs.digest import canonical_document
from specs.field_types import Architecture
from specs.pipeline.section_requests import deployment_request
from specs.pipeline.simulation_section import Deployment, LocalFleet
from specs.store_reference import StoreReference
from tasks.deploy.fleet.fleets import create_fleet
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.task import roll_out
from tasks.deploy.trust.signer import chosen_signer
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id


@guarded
@flow(
    name="deployment-sync",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def deployment_sync(
    spec: Deployment,
    store: StoreReference = None,
    tested: dict[str, str] | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    builds: dict[Architecture, str] | None = None,
) -> JobRecord:
    """Returns the deployment job, ended: Succeeded, Failed or Canceled.

    Args:
        spec: The pipeline's section ``deployment``.
        store: URL of the store; SIMYARD_STORE, else ``.simyard`` in the working directory.
        tested: Digest of each robot application that a batch tested, by name; another digest is refused.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.
        builds: Digest of the version's bundle for each architecture, as the pipeline settled them; others are refused.

    Raises:
        DocumentError: The fleet, application or version does not exist, or is not what was tested; or there are no
            keys to sign with.
    """
    opened = open_store(store)
    signer = chosen_signer(opened, spec.trust, local=isinstance(spec.fleet, LocalFleet) and spec.fleet.localAgents > 0)
    version = deployed_version(spec, opened, numbered_finder(opened, versions), tested)

    def work(given: str) -> JobRecord:
        request = deployment_request(spec, store_id=store_id(opened), version=str(version.number), token=given)
        robots = _robots(spec, opened, signer.root_of_trust if signer else None)
        return roll_out(
            opened.url,
            request,
            digest=version.digest,
            builds=version.digests if builds is None else builds,
            token=request.clientRequestToken,
            rules=spec.rollOut,
            robots=robots,
            signer=signer,
        )

    identity = {"spec": canonical_document(spec), "digest": version.digest}
    return completed_job(run_stage(opened, "deployment-sync", identity, token, work))


def agents_folder(store: Store) -> Path:
    """Returns where robots on this machine keep their versions: with a store in a folder, else in the cache."""
    if store.url.startswith("file://"):
        return Path(unquote(store.url.removeprefix("file://"))) / "agents"
    return cache_folder() / "agents" / store_id(store)


def _robots(
    spec: Deployment, store: Store, root_of_trust: Path | None
) -> Callable[[], AbstractContextManager[Collection[str] | None]] | None:
    """Returns what starts the robots of a demonstration once its fleet, made here, is taken; None for real ones."""
    fleet = spec.fleet
    if not isinstance(fleet, LocalFleet) or not fleet.localAgents:
        return None
    create_fleet(store, fleet.name)
    folder = agents_folder(store)
    return partial(local_agents, store, fleet.name, fleet.localAgents, folder, root_of_trust=root_of_trust)
