"""Decides whether a deployment is signed, and with which keys; its record says so, and the signer signs its plan.

What waits in the queue is signed by a worker only if the owner vouches for it: the queue is in the store.

Imports nothing heavy.
"""

import logging
import os
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pydantic import Field, JsonValue

from specs.base import Fault, Spec, canonical_json
from specs.errors import TrustRefused
from specs.field_types import Architecture, S3Object
from specs.settings import OWNER_KEY
from tasks.deploy.fleet.states import Desired, Signature
from tasks.storage.jobs.authenticator import has_owner_key, owner_authenticator
from tasks.storage.jobs.records import JobRecord

KEYS_VARIABLE = "SIMYARD_KEYS"
UNSIGNED_ALARM = (
    "UNSIGNED: nobody's key vouches for this deployment; whoever can write to the store could have made it."
)
_LOG = logging.getLogger(__name__)
UNSIGNED = "unsigned"
_TRUST, _PLAN, _SIGNATURE = "trust", "plan", "plan_signature"
_VOUCHED, _QUEUED = "vouched", "queued deployment"
_VOUCHED_S = 30 * 86_400.0  # as long as what is signed for a robot
_CLOCKS_S = 3600.0  # by which those of two machines may differ


def chosen_keys() -> Path | None:
    """Returns the folder that SIMYARD_KEYS names, or None."""
    chosen = os.environ.get(KEYS_VARIABLE)
    return Path(chosen).expanduser().absolute() if chosen else None


def trust_faults(*, trust: str, local: bool) -> list[Fault]:
    """Returns why a deployment could not be signed.

    Args:
        trust: What the document says, signed or unsigned.
        local: Whether the robots are agents of this machine, for which keys are made.
    """
    keys = chosen_keys()
    if trust == "unsigned" or (local and keys is None):
        return []
    if keys is None:
        allowed = f"keys: simyard fleet keys init --keys DIR, then {KEYS_VARIABLE}=DIR; or trust: unsigned"
        return [Fault(path="deployment.trust", value=trust, allowed=allowed)]
    if not (keys / "root.json").is_file():
        allowed = "a folder that simyard fleet keys init --keys DIR made"
        return [Fault(path=KEYS_VARIABLE, value=str(keys), allowed=allowed)]
    return []


def condition_fault(condition: S3Object, etag: str) -> Fault | None:
    """Returns why keys do not vouch for a download condition: a script that robots run, and no gate has seen.

    Args:
        condition: As the document names it.
        etag: What lies there now.
    """
    named = (condition.etag or "").strip('"')
    if named == etag.strip('"'):
        return None
    what = f"{condition.bucket}/{condition.key}"
    allowed = f"the ETag of the script that you mean, since robots run it; {what} has {etag.strip(chr(34))!r} now"
    return Fault(path="deploymentConfig.downloadConditionFile.etag", value=repr(condition.etag), allowed=allowed)


class Vouched(Spec):
    """What a worker with keys takes of the queue.

    Attributes:
        digest: Of the bundle that is deployed; empty for a sync, and for another job.
        builds: Of the bundle for each architecture.
        at_s: When it was vouched for; seconds since 1970.
        mac: By the owner's key: of this, of the job and of its request.
    """

    digest: str = ""
    builds: dict[Architecture, str] = Field(default_factory=dict[Architecture, str])
    at_s: float
    mac: str = ""


def vouch_queued(
    job: str, request: Mapping[str, JsonValue], digest: str = "", builds: Mapping[Architecture, str] | None = None
) -> dict[str, JsonValue]:
    """Returns what the record of a queued job says besides, so that a worker with keys takes it.

    Args:
        job: Its id.
        request: As it is recorded.
        digest: Of the bundle that a deployment's version stands for now; empty for a sync, and for another job.
        builds: Of the bundle for each architecture.
    """
    vouched = Vouched(digest=digest, builds=dict(builds or {}), at_s=time.time())
    mac = owner_authenticator(job, "").mac(_QUEUED, _vouched_bytes(request, vouched))
    return {_VOUCHED: vouched.model_copy(update={"mac": mac}).model_dump(mode="json")}


def require_vouched(record: JobRecord, *, sync: bool) -> Vouched:
    """Returns what the owner has vouched for in the record of a queued job.

    Args:
        record: The job's, which anybody who writes to the store may have made.
        sync: Whether it shall be worked off as a sync, or is no deployment: there is no bundle to vouch for.

    Raises:
        TrustRefused: She has not, for this request, or not lately; says what helps.
    """
    try:
        vouched = Vouched.model_validate(record.detail.get(_VOUCHED))
        body = _vouched_bytes(record.request, vouched)
    except ValueError as exc:
        raise _not_vouched(record) from exc
    known = has_owner_key() and owner_authenticator(record.id, "").authenticates(vouched.mac, _QUEUED, body)
    if not known or sync == bool(vouched.digest):
        raise _not_vouched(record)
    if not -_CLOCKS_S <= time.time() - vouched.at_s <= _VOUCHED_S:
        raise TrustRefused(f"{record.id} was queued too long ago, or by a clock that is wrong; ask for it again")
    return vouched


def _vouched_bytes(request: Mapping[str, JsonValue], vouched: Vouched) -> bytes:
    return canonical_json({"request": dict(request), **vouched.model_dump(mode="json", exclude={"mac"})})


def _not_vouched(record: JobRecord) -> TrustRefused:
    what = f"{record.id} is not signed: the key in {OWNER_KEY} does not vouch for it as it stands"
    return TrustRefused(f"{what}; give gateway and worker the same key, or find out who writes to the store")


@dataclass(frozen=True)
class Admission:
    """What robots shall accept.

    Attributes:
        fleet: Of the robots.
        deployment: The job's id.
        digests: Of the bundles.
        robots: Who is asked; the keys must vouch that they belong to the fleet.
        own: Those of them that this process has made for its own demonstration: it vouches for them now.
        follows: The deployment that this one is a sync of, or empty: then what was in force for the fleet is withdrawn.
    """

    fleet: str
    deployment: str
    digests: Sequence[str]
    robots: Sequence[str] = ()
    own: Collection[str] = ()
    follows: str = ""


# The plan is read again when a controller takes over, and when a fleet is synced. Whoever can write to the store
# could change it between, and have the deployer's key sign the change.
class Signer(Protocol):
    """Vouches for a deployment (`tasks.deploy.trust.signer.DeploymentSigner`)."""

    def admit(self, wanted: Admission) -> None:
        """Makes robots accept a deployment and its bundles, and nothing that it supersedes."""
        ...

    def require_members(self, fleet: str, robots: Sequence[str]) -> None:
        """Raises TrustRefused for robots of whom no key says that they belong to the fleet."""
        ...

    def require_in_force(self, fleet: str, deployment: str) -> None:
        """Raises TrustRefused for a deployment that was withdrawn, or superseded."""
        ...

    def withdraw(self, deployment: str) -> object:
        """Has robots accept a deployment no more; those that have begun with it go on."""
        ...

    def renew(self) -> object:
        """Keeps the signed metadata from expiring; costs nothing while it is far from that."""
        ...

    def sign(self, desired: Desired) -> Desired:
        """Returns what is asked of a robot, signed."""
        ...

    def is_own(self, desired: Desired) -> bool:
        """Returns whether this signer's key has signed a desired state as it stands."""
        ...

    def sign_plan(self, plan: bytes) -> Signature:
        """Returns a signature under a plan."""
        ...

    def check_plan(self, plan: bytes, signature: Signature) -> None:
        """Raises TrustRefused for a plan that this signer's key has not signed."""
        ...


def sign_plan(signer: Signer | None, wanted: Admission, plan: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """Returns what a job's record holds of a plan, once robots will accept its bundles.

    Args:
        signer: Who vouches, or None.
        wanted: What robots shall accept.
        plan: The plan as the record holds it.
    """
    if signer is None:
        shown = ", ".join(digest[:12] for digest in wanted.digests)
        _LOG.warning("UNSIGNED: %s asks robots to run %s, and nobody's key vouches for it", wanted.deployment, shown)
        return {_PLAN: plan, _TRUST: UNSIGNED}
    signer.admit(wanted)
    signature = signer.sign_plan(_bytes(wanted.deployment, plan))
    return {_PLAN: plan, _TRUST: f"signed by {signature.keyid}", _SIGNATURE: signature.model_dump(mode="json")}


def check_recorded_plan(signer: Signer | None, record: JobRecord | None, fleet: str) -> None:
    """Does nothing for a record whose plan, if it has one, is for the fleet, signed by the signer, and in force.

    Args:
        signer: Who must have signed it; None where nothing is signed.
        record: The job's, if there is one.
        fleet: Whose robots are asked.

    Raises:
        TrustRefused: The plan was changed, was not signed, or by a key that was replaced; or it is for another fleet,
            was canceled, or was superseded.
    """
    if record is None or _PLAN not in record.detail:
        return
    signature, plan = record.detail.get(_SIGNATURE), record.detail[_PLAN]
    planned = plan.get("fleet") if isinstance(plan, dict) else None
    if planned != fleet:
        what = f"{record.id!r:.100} is a deployment to the fleet {planned!r:.100}, and not to {fleet!r}"
        raise TrustRefused(f"{what}; find out who writes to the store, and make a new deployment")
    if signer is None:
        return
    if not isinstance(signature, Mapping) or not isinstance(plan, dict):
        raise TrustRefused(f"the plan of {record.id} is not signed; make a new deployment")
    signer.check_plan(_bytes(record.id, plan), Signature.model_validate(signature))
    signer.require_in_force(fleet, record.id)


def is_unsigned(record: JobRecord) -> bool:
    """Returns whether a deployment's record says that it is unsigned."""
    return record.detail.get(_TRUST) == UNSIGNED


def is_signed(record: JobRecord) -> bool:
    """Returns whether a deployment's record says that it is signed."""
    return str(record.detail.get(_TRUST, "")).startswith("signed")


def _bytes(job: str, plan: Mapping[str, JsonValue]) -> bytes:
    return canonical_json({"job": job, "plan": dict(plan)})
