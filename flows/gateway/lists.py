"""The eleven List operations that come in pages."""

from collections.abc import Callable
from typing import Any

from flows.gateway.gateway import Gateway, Handler, Handlers
from specs.base import Spec
from tasks.applications.list_pages import list_robot_applications_page, list_simulation_applications_page
from tasks.deploy.answers.list_pages import list_deployment_jobs_page, list_fleets_page, list_robots_page
from tasks.export.job.list_pages import list_export_jobs_page
from tasks.simulate.lists.job_pages import list_batches_page, list_jobs_page
from tasks.storage.base.store import Store
from tasks.worlds.job.list_pages import list_generation_jobs_page, list_templates_page, list_worlds_page


def _listing(page: Callable[[Store, Any], Spec]) -> Handler:
    def answer(gateway: Gateway, request: Spec) -> Spec:
        return page(gateway.store, request)

    return answer


HANDLERS: Handlers = {
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
