"""Which fleet something belongs to, for keys that are limited to fleets."""

from specs.arn import ResourceKind, reference_path
from specs.errors import DocumentError
from tasks.deploy.fleet.robots import known_robot
from tasks.gateway.access.rights import FleetOf
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read


def fleet_ties(store: Store) -> FleetOf:
    """Returns a function that says which fleet of a store a robot is in, or a deployment is of."""

    def fleet_of(kind: ResourceKind, path: str) -> str:
        try:
            if kind == "robot":
                robot = known_robot(store, path)
                return robot.fleet if robot else ""
            return reference_path(str(read(store, "deployment-job", path).request.get("fleet", "")))
        except DocumentError:  # nothing is called so
            return ""

    return fleet_of
