"""What the deployer signs: who belongs to which fleet, which deployments are in force, and desired states.

A desired state has an Ed25519 signature over its canonical JSON.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence

from pydantic import ConfigDict, Field, ValidationError
from securesystemslib.exceptions import UnverifiedSignatureError, VerificationError

from specs.base import Spec, canonical_json
from specs.errors import TrustRefused
from tasks.deploy.fleet.states import Desired, Signature
from tasks.deploy.trust.keyring import CryptoSigner, Key, RawSignature, Targets

# The same key signs metadata, which is JSON: with this in front, one can never be taken for the other.
_PREFIX = b"simyard desired state 1\n"
FIELD = "x-simyard-fleets"
MOST_IN_FORCE = 32
"""Deployments of one roll-out that are in force: itself, and its latest syncs."""
MOST_REMEMBERED = 64
"""Deployments of a fleet that are remembered as withdrawn, so that none of them begins again."""
_SHOWN = 5


def sign_desired(desired: Desired, signer: CryptoSigner) -> Desired:
    """Returns the desired state with a signature under it."""
    made = signer.sign(payload(desired))
    return desired.model_copy(update={"signature": Signature(keyid=made.keyid, value=made.signature)})


def verify_desired(desired: Desired, keys: Mapping[str, Key]) -> None:
    """Does nothing for a desired state that one of the keys has signed as it stands.

    Args:
        desired: What was asked of a robot.
        keys: The deployer's, by id.

    Raises:
        TrustRefused: It is not signed, by another key, or was changed.
    """
    signature = desired.signature
    if signature is None:
        raise TrustRefused("it is not signed; deploy with the keys that this robot trusts (SIMYARD_KEYS)")
    key = keys.get(signature.keyid)
    if key is None:
        who = f"{signature.keyid[:16]}, which is not the deployer's key any more, or never was"
        raise TrustRefused(f"it is signed by {who}; deploy again with the keys that this robot trusts")
    try:
        key.verify_signature(RawSignature(signature.keyid, signature.value), payload(desired))
    except (UnverifiedSignatureError, VerificationError) as exc:
        raise TrustRefused("it was changed after it was signed; find out who writes to the store") from exc


def payload(desired: Desired) -> bytes:
    """Returns the bytes that are signed.

    What has its default is left out: a robot whose Simyard is newer, and knows more fields, finds the same bytes.

    Raises:
        TrustRefused: It holds what no desired state that was signed can hold, such as an infinite number.
    """
    document = desired.model_dump(mode="json", exclude={"signature"}, exclude_defaults=True)
    try:
        return _PREFIX + canonical_json(document)
    except ValueError as exc:
        raise TrustRefused(f"it cannot have been signed: {exc}") from exc


class _Signed(Spec):
    """A part of signed metadata: who reads it may be older than who has signed it."""

    model_config = ConfigDict(extra="ignore")


# A desired state alone stays valid for weeks. So it counts only while the current metadata names its deployment as in
# force for the fleet of its robot: what was withdrawn or superseded stays so for whoever has seen that, and for
# everybody once the timestamp that was current before it has expired.
#
# There is one roll-out in force for a fleet: a deployment, and the syncs that brought it to more robots. Nothing here
# grows with the number of deployments; the robots are as many as there are.
class Withdrawal(_Signed):
    """A deployment that is not in force any more.

    Attributes:
        until_s: Until when a robot that has seen nothing newer may accept it, if somebody puts the old metadata back;
            seconds since 1970.
    """

    deployment: str
    until_s: int


class SignedFleet(_Signed):
    """A fleet.

    Attributes:
        deployments: Ids of those in force, oldest first.
        digests: Of the bundles that they bring.
        withdrawn: The latest that were in force before, oldest first.
    """

    deployments: list[str] = Field(default_factory=list[str])
    digests: list[str] = Field(default_factory=list[str])
    withdrawn: list[Withdrawal] = Field(default_factory=list[Withdrawal])

    def without(self, until_s: int, deployments: Collection[str]) -> "SignedFleet":
        """Returns the fleet after those were withdrawn."""
        gone = [Withdrawal(deployment=each, until_s=until_s) for each in self.deployments if each in deployments]
        kept = [each for each in self.deployments if each not in deployments]
        withdrawn = [*self.withdrawn, *gone][-MOST_REMEMBERED:]
        return SignedFleet(deployments=kept, digests=self.digests if kept else [], withdrawn=withdrawn)


class SignedFleets(_Signed):
    """All fleets.

    Attributes:
        robots: The fleet of each robot.
        until_s: When the last of the timestamps expires that were current before this was signed; seconds since 1970.
    """

    robots: dict[str, str] = Field(default_factory=dict[str, str])
    fleets: dict[str, SignedFleet] = Field(default_factory=dict[str, SignedFleet])
    until_s: int = 0

    def replacing(self, expires_s: float) -> "SignedFleets":
        """Returns the same while a timestamp is current that expires then."""
        return self.model_copy(update={"until_s": max(self.until_s, int(expires_s))})

    def fleet_of(self, deployment: str) -> str | None:
        """Returns the fleet in which a deployment is in force, or None."""
        return next((name for name, fleet in self.fleets.items() if deployment in fleet.deployments), None)

    def ends_s(self, deployment: str) -> int | None:
        """Returns until when a withdrawn deployment may still be accepted somewhere; None for any other."""
        found = (each for fleet in self.fleets.values() for each in fleet.withdrawn if each.deployment == deployment)
        return next((each.until_s for each in found), None)

    def unsigned_members(self, fleet: str, robots: Iterable[str]) -> list[str]:
        """Returns those of the robots of whom nobody has signed that they belong to the fleet."""
        return [robot for robot in robots if self.robots.get(robot) != fleet]

    def known(self, fleet: str) -> SignedFleet:
        """Returns what there is of a fleet; nothing of a new one."""
        return self.fleets.get(fleet, SignedFleet())

    def enlisted(self, fleet: str, robots: Iterable[str]) -> "SignedFleets":
        """Returns the fleets with the robots in that one."""
        return self._with(robots={**self.robots, **dict.fromkeys(robots, fleet)})

    def dismissed(self, robots: Collection[str]) -> "SignedFleets":
        """Returns the fleets with the robots in none."""
        return self._with(robots={name: fleet for name, fleet in self.robots.items() if name not in robots})

    def dissolved(self, fleet: str) -> "SignedFleets":
        """Returns the fleets without that one; its robots are in none."""
        left = {name: each for name, each in self.fleets.items() if name != fleet}
        robots = {name: each for name, each in self.robots.items() if each != fleet}
        return self._with(robots=robots, fleets=left)

    def begun(self, fleet: str, deployment: str, digests: Sequence[str]) -> "SignedFleets":
        """Returns the fleets with a new deployment in force in one, and none that was before; or as they are, if it is.

        Raises:
            TrustRefused: The deployment was withdrawn.
        """
        before = self.known(fleet)
        self._refuse_withdrawn(fleet, deployment)
        if deployment in before.deployments and set(digests) <= set(before.digests):
            return self
        others = before.without(self.until_s, set(before.deployments) - {deployment})
        after = others.model_copy(update={"deployments": [deployment], "digests": sorted(set(digests))})
        return self._with(fleets={**self.fleets, fleet: after})

    def followed(self, fleet: str, deployment: str, last: str, digests: Sequence[str]) -> "SignedFleets":
        """Returns the fleets with a sync in force in one, beside the deployment that it follows.

        Raises:
            TrustRefused: The sync, or what it follows, is not in force.
        """
        self._refuse_withdrawn(fleet, deployment)
        self.require_in_force(fleet, last)
        before = self.known(fleet)
        first, *rest = before.deployments
        after = rest if deployment in before.deployments else [*rest, deployment]
        deployments = [first, *after[1 - MOST_IN_FORCE :]]
        kept = before.without(self.until_s, set(before.deployments) - set(deployments))
        both = sorted({*before.digests, *digests})
        return self._with(
            fleets={**self.fleets, fleet: kept.model_copy(update={"deployments": deployments, "digests": both})}
        )

    def withdrawn(self, deployment: str) -> "SignedFleets":
        """Returns the fleets with a deployment in force nowhere; with one that was synced, its syncs are withdrawn."""
        name = self.fleet_of(deployment)
        if name is None:
            return self
        before = self.fleets[name]
        gone = set(before.deployments) if before.deployments[0] == deployment else {deployment}
        return self._with(fleets={**self.fleets, name: before.without(self.until_s, gone)})

    def require_in_force(self, fleet: str, deployment: str) -> None:
        """Does nothing for a deployment that is in force in a fleet.

        Raises:
            TrustRefused: It is not.
        """
        if deployment not in self.known(fleet).deployments:
            what = f"{deployment!r} is not in force in {fleet!r}: it was canceled, or superseded, or never signed"
            raise TrustRefused(f"{what}; make a new deployment")

    def require_members(self, fleet: str, robots: Iterable[str]) -> None:
        """Does nothing for robots that belong to a fleet by what was signed.

        Raises:
            TrustRefused: They do not; says the command to run.
        """
        if story := unsigned_members_text(fleet, self.unsigned_members(fleet, robots)):
            raise TrustRefused(story)

    def admit(self, desired: Desired) -> None:
        """Does nothing for a desired state whose deployment is in force for its robot.

        Raises:
            TrustRefused: It is not.
        """
        fleet = self.robots.get(desired.robot)
        if fleet is None:
            raise TrustRefused(f"{desired.robot!r} is in no fleet that a key vouches for; simyard fleet vouch FLEET")
        vouched = self.known(fleet)
        if desired.deployment not in vouched.deployments:
            what = f"{desired.deployment!r} is not in force in {fleet!r}: it was withdrawn, or superseded"
            raise TrustRefused(f"{what}; simyard fleet sync {fleet}, or deploy again")
        if desired.digest not in vouched.digests:
            what = f"bundle {desired.digest[:12]} is not on the deployer's signed list for {fleet!r}"
            raise TrustRefused(f"{what}; deploy it again")

    def digests(self) -> set[str]:
        """Returns the bundles of all that is in force."""
        return {digest for fleet in self.fleets.values() for digest in fleet.digests}

    def _refuse_withdrawn(self, fleet: str, deployment: str) -> None:
        if any(each.deployment == deployment for each in self.known(fleet).withdrawn):
            raise TrustRefused(f"{deployment!r} was withdrawn, and stays so; make a new deployment")

    def _with(self, **changes: Mapping[str, str] | Mapping[str, SignedFleet]) -> "SignedFleets":
        return self.model_copy(update=changes)


def read_fleets(deployer: Targets) -> SignedFleets:
    """Returns what the deployer's metadata says of fleets; of none, before the first was signed.

    Raises:
        TrustRefused: It says something that cannot be read.
    """
    found = deployer.unrecognized_fields.get(FIELD)
    try:
        return SignedFleets() if found is None else SignedFleets.model_validate(found)
    except ValidationError as exc:
        raise TrustRefused("what is signed of fleets cannot be read: install a newer Simyard here") from exc


def write_fleets(deployer: Targets, fleets: SignedFleets) -> None:
    """Has the deployer's metadata say that of fleets, and list no bundle that nothing in force brings."""
    deployer.unrecognized_fields[FIELD] = fleets.model_dump(mode="json")
    wanted = fleets.digests()
    for path, target in list(deployer.targets.items()):
        if target.hashes.get("sha256") not in wanted:
            del deployer.targets[path]


def unsigned_members_text(fleet: str, strangers: Sequence[str]) -> str:
    """Returns what to do about robots of whom nobody has signed that they belong to a fleet; empty for none."""
    if not strangers:
        return ""
    shown = ", ".join(repr(robot) for robot in strangers[:_SHOWN])
    more = f" and {len(strangers) - _SHOWN} more" if len(strangers) > _SHOWN else ""
    what = f"no key vouches that {shown}{more} belong to {fleet!r}"
    return f"{what}; if they do: simyard fleet vouch {fleet} (with the keys, SIMYARD_KEYS)"
