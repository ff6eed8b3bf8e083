"""What the keys of this machine sign of a fleet: who belongs to it, and that a cancelled deployment is withdrawn.

It also keeps what is signed from expiring.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from specs.arn import parse_reference
from specs.base import Fault
from specs.errors import DocumentError
from tasks.deploy.fleet.fleet_registry import members, read_fleet, robot_name
from tasks.deploy.rollout.operator_commands import steer, withdraw_canceled
from tasks.deploy.trust.signed_fleets import SignedFleets
from tasks.deploy.trust.signer import DeploymentSigner, signers_here
from tasks.deploy.trust.trust_record import chosen_keys, is_signed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, read


@dataclass(frozen=True)
class MembershipChange:
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
        self.signer.sign_fleets(self._changed)

    def _changed(self, fleets: SignedFleets) -> SignedFleets:
        return fleets.enlisted(self.fleet, self.joins).dismissed(set(self.leaves))


def membership_change(
    store: Store, signer: DeploymentSigner, fleet: str, robots: Sequence[str] = ()
) -> MembershipChange:
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
    name, fleets = read_fleet(store, fleet).name, signer.fleets()
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
    joins = tuple(fleets.unsigned_members(name, wanted))
    return MembershipChange(signer, name, joins, leaves, len((signed | set(joins)) - set(leaves)))


_KIND = "deployment-job"


def cancel_deployment(store: Store, job: str) -> JobRecord:
    """Returns the record of a deployment that is being cancelled; robots that have not begun with it accept it no more.

    One that has ended stays as it ended, and is withdrawn if it is in force.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended, and is not in force by the keys of this machine.
        TrustRefused: The signed metadata is not what it was.
    """
    signers = signers_here(store)
    try:
        record = steer(store, job, "cancel")
    except DocumentError:
        signers = [signer for signer in signers if signer.fleets().fleet_of(job)]
        if not signers:
            raise
        record = read(store, _KIND, job)
    for signer in signers:
        signer.withdraw(job)
    return record


def withdrawal_notes(store: Store, arn: str) -> Iterator[str]:
    """Yields what is left of the time in which a robot may accept a cancelled deployment; nothing for what is none."""
    reference = parse_reference(arn)
    if reference.kind != _KIND:
        return
    record = read(store, _KIND, reference.path)
    if not is_signed(record):
        return
    ends_s = [signer.fleets().ends_s(record.id) for signer in signers_here(store)]
    known = [each for each in ends_s if each is not None]
    if known:
        yield withdrawal_note(record.id, max(known))
        return
    who = "no key of it is here" if is_terminal(record) else "its controller withdraws it; no key of it is here"
    yield f"{who}: with the keys (SIMYARD_KEYS), the same command again makes sure that no robot accepts it later"


def withdrawal_note(deployment: str, ends_s: float) -> str:
    """Returns until when a withdrawn deployment may be accepted somewhere."""
    left_h = (ends_s - time.time()) / 3600
    if left_h <= 0:
        return f"{deployment} is withdrawn; no robot accepts it any more"
    until = datetime.fromtimestamp(ends_s, UTC).strftime("%Y-%m-%d %H:%M UTC")
    who = "a robot that has seen nothing newer may accept it if somebody puts it back"
    return f"{deployment} is withdrawn; {who}, until {until} (for {left_h:.1f} h)"


def force_lines(fleets: SignedFleets) -> Iterator[str]:
    """Yields a line for each fleet of which something is signed, and for what was withdrawn and may be accepted yet."""
    for name, fleet in sorted(fleets.fleets.items()):
        robots = sum(each == name for each in fleets.robots.values())
        yield f"{name}: {robots} robots; in force: {', '.join(fleet.deployments) or 'nothing'}"
        yield from (
            f"{name}: {withdrawal_note(each.deployment, each.until_s)}"
            for each in fleet.withdrawn
            if each.until_s > time.time()
        )
    for name in sorted(set(fleets.robots.values()) - set(fleets.fleets)):
        yield f"{name}: {sum(each == name for each in fleets.robots.values())} robots; in force: nothing"


def renew_metadata_here(store: Store) -> tuple[str, ...]:
    """Keeps what the keys in SIMYARD_KEYS have signed from expiring, if it is for this store; returns what lacks a key.

    Deployments that were canceled without keys are withdrawn first.

    Raises:
        TrustRefused: The metadata in the store is not what the keys signed, or is older than it was.
    """
    signers = signers_here(store) if chosen_keys() else []
    return tuple(f"{role} has to be signed anew" for signer in signers for role in _renewed(store, signer))


def _renewed(store: Store, signer: DeploymentSigner) -> Iterator[str]:
    in_force = [job for fleet in signer.fleets().fleets.values() for job in fleet.deployments]
    withdraw_canceled(store, signer, in_force)
    yield from signer.renew()
