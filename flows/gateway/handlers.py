"""The table of all operations: what answers each of them, joined from the families, and the eleven lists."""

from collections.abc import Callable, Mapping
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

_LISTS: Mapping[str, Callable[[Store, Any], Spec]] = {
    "ListDeploymentJobs": list_deployment_jobs_page,
    "ListFleets": list_fleets_page,
    "ListRobotApplications": list_robot_applications_page,
    "ListRobots": list_robots_page,
    "ListSimulationApplications": list_simulation_applications_page,
    "ListSimulationJobBatches": list_batches_page,
    "ListSimulationJobs": list_jobs_page,
    "ListWorldExportJobs": list_export_jobs_page,
    "ListWorldGenerationJobs": list_generation_jobs_page,
    "ListWorldTemplates": list_templates_page,
    "ListWorlds": list_worlds_page,
}


def _listing(page: Callable[[Store, Any], Spec]) -> Handler:
    return lambda gateway, request: page(gateway.store, request)


def _with_tags(handler: Handler) -> Handler:
    """Returns a handler whose answers have tags, be there any or not: programs look into them without asking."""

    def answer(gateway: Gateway, request: Spec) -> Spec:
        found = handler(gateway, request)
        has_none = "tags" in type(found).model_fields and getattr(found, "tags", None) is None
        return found.model_copy(update={"tags": {}}) if has_none else found

    return answer


_FAMILIES = (application_calls, fleet_calls, simulation_calls, tag_calls, world_calls)
HANDLERS: Handlers = {
    **{name: _with_tags(handler) for family in _FAMILIES for name, handler in family.HANDLERS.items()},
    **{name: _listing(page) for name, page in _LISTS.items()},
}
