"""The flow `deployment-sync`: rolls a tested version out to a fleet, in waves."""

from prefect import flow

from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.parameter.document_parameter import DeploymentParameter
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.prefect_orchestrator import flow_result, run_name, under_prefect
from flows.run.cancellation import cancel_with_flow_run
from flows.stage import deployment_stage
from specs.field_types import Architecture
from tasks.storage.jobs.records import JobRecord


@guarded
@flow(
    name="deployment-sync",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def deployment_sync(
    spec: DeploymentParameter,
    store: StoreParameter = None,
    tested: dict[str, str] | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    builds: dict[Architecture, str] | None = None,
) -> JobRecord:
    """Returns the deployment job, ended: Succeeded, Failed or Canceled.

    Args:
        spec: The pipeline's section ``deployment``, or ``{document: path}``.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        tested: Digest of each robot application that a batch tested, by name; another digest is refused.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.
        builds: Digest of the version's bundle for each architecture, as the pipeline settled them; others are refused.

    Raises:
        DocumentError: The fleet, application or version does not exist, or is not what was tested; or there are no
            keys to sign with.
    """
    with under_prefect():
        return completed_job(
            flow_result(
                lambda: deployment_stage.deployment_sync(spec, store_at(store), tested, versions, token, builds=builds),
                token,
            )
        )
