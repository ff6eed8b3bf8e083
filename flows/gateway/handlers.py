"""The table of all operations: what answers each of them, joined from the families, and the eleven lists."""

from collections.abc import Callable
from typing import Any

from flows.gateway import application_calls, fleet_calls, simulation_calls, tag_calls, world_calls
from flows.gateway.gateway import Gateway, Handler, Handlers
from specs.base import Spec
from tasks.applications.application_answers import list_robot_applications_page, list_simulation_applications_page
from tasks.deploy.fleet_descriptions import list_deployment_jobs_page, list_fleets_page, list_robots_page
from tasks.export.job.export_answers import list_export_jobs_page
from tasks.simulate.batch.job_lists import list_batches_page, list_jobs_page
from tasks.storage.base.store import Store
from tasks.worlds.job.world_answers import list_generation_jobs_page, list_templates_page, list_worlds_page

_JOB_HANDLERS: Handlers = {
    **fleet_calls.DEPLOYMENT_HANDLERS,
    **simulation_calls.JOB_HANDLERS,
    **simulation_calls.BATCH_HANDLERS,
    **world_calls.EXPORT_HANDLERS,
    **world_calls.GENERATION_HANDLERS,
}
_RESOURCE_HANDLERS: Handlers = {
    **application_calls.HANDLERS,
    **world_calls.TEMPLATE_HANDLERS,
    **world_calls.WORLD_HANDLERS,
    **fleet_calls.FLEET_HANDLERS,
    **tag_calls.HANDLERS,
}


def _listing(page: Callable[[Store, Any], Spec]) -> Handler:
    def answer(gateway: Gateway, request: Spec) -> Spec:
        return page(gateway.store, request)

    return answer


_LIST_HANDLERS: Handlers = {
    "ListDeploymentJobs": _listing(list_deployment_jobs_page),
    "ListFleets": _listing(list_fleets_page),
    "ListRobotApplications": _listing(list_robot_applications_page),
    "ListRobots": _listing(list_robots_page),
    "ListSimulationApplications": _listing(list_simulation_applications_page),
    "ListSimulationJobBatches": _listing(list_batches_page),
    "ListSimulationJobs": _listing(list_jobs_page),
    "ListWorldExportJobs": _listing(list_export_jobs_page),
    "ListWorldGenerationJobs": _listing(list_generation_jobs_page),
    "ListWorldTemplates": _listing(list_templates_page),
    "ListWorlds": _listing(list_worlds_page),
}


def _with_tags(handler: Handler) -> Handler:
    """Returns a handler whose answers have tags, be there any or not: programs look into them without asking."""

    def answer(gateway: Gateway, request: Spec) -> Spec:
        found = handler(gateway, request)
        has_none = "tags" in type(found).model_fields and getattr(found, "tags", None) is None
        return found.model_copy(update={"tags": {}}) if has_none else found

    return answer


_FAMILIES: Handlers = {**_JOB_HANDLERS, **_LIST_HANDLERS, **_RESOURCE_HANDLERS}
HANDLERS: Handlers = {name: _with_tags(handler) for name, handler in _FAMILIES.items()}
