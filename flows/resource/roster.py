"""Who belongs to a fleet by the store's records, beside who belongs to it by what is signed."""

from collections.abc import Sequence
from dataclasses import dataclass

from specs.base import Fault
from specs.errors import DocumentError
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.robots import members, robot_name
from tasks.deploy.trust.signer import DeploymentSigner
from tasks.deploy.trust.vouched_fleets import VouchedFleets
from tasks.storage.base.store import Store


@dataclass(frozen=True)
class RosterChange:
    """What would be signed of a fleet.

    Attributes:
        joins: Robots for which no key has vouched yet.
        leaves: Robots that are signed into the fleet, and are not in it by the records.
        members: How many robots it has then.
    """

    signer: DeploymentSigner
    fleet: str
    joins: tuple[str, ...]
    leaves: tuple[str, ...]
    members: int

    @property
    def lines(self) -> list[str]:
        """A line for each robot that joins or leaves."""
        return [*(f"+ {name}" for name in self.joins), *(f"- {name}" for name in self.leaves)]

    def sign(self) -> None:
        """Signs it."""
        self.signer.vouch(self._changed)

    def _changed(self, fleets: VouchedFleets) -> VouchedFleets:
        return fleets.enlisted(self.fleet, self.joins).dismissed(set(self.leaves))


def roster_change(store: Store, signer: DeploymentSigner, fleet: str, robots: Sequence[str] = ()) -> RosterChange:
    """Returns what would be signed so that keys vouch for the robots of a fleet.

    Args:
        store: Where the fleet is.
        signer: Whose keys.
        fleet: Its name or ARN.
        robots: Names or ARNs of those that are meant; all robots of the fleet, if there are none.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: A robot is not in the fleet.
    """
    name, fleets = read_fleet(store, fleet)[0].name, signer.fleets()
    there = [robot.name for robot in members(store, name)]
    wanted = [robot_name(robot) for robot in robots] or there
    if faults := [
        Fault(path="robot", value=repr(robot), allowed=f"a robot of {name}; simyard fleet register {name} ROBOT")
        for robot in wanted
        if robot not in there
    ]:
        raise DocumentError(faults)
    signed = {robot for robot, its in fleets.robots.items() if its == name}
    leaves = () if robots else tuple(sorted(signed - set(there)))
    joins = tuple(fleets.strangers(name, wanted))
    return RosterChange(signer, name, joins, leaves, len((signed | set(joins)) - set(leaves)))
