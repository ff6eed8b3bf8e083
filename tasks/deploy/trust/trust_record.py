"""The trust in a deployment's record, and the signature under its plan. Imports nothing heavy.

The plan is read again when a controller takes over, and when a fleet is synced. Whoever can write to the store could
change it between, and have the deployer's key sign the change.
"""

import logging
from collections.abc import Mapping, Sequence
from typing import Protocol

from pydantic import JsonValue

from specs.digest import canonical_json
from specs.errors import TrustRefused
from tasks.deploy.fleet.states import Desired, Signature
from tasks.storage.jobs.records import JobRecord

_LOG = logging.getLogger(__name__)
UNSIGNED = "unsigned"
_TRUST, _PLAN, _SIGNATURE = "trust", "plan", "plan_signature"


class Signer(Protocol):
    """Vouches for a deployment (`tasks.deploy.trust.signer.DeploymentSigner`)."""

    def admit(self, digest: str) -> None:
        """Makes robots accept a bundle."""
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


def vouch_for_plan(
    signer: Signer | None, job: str, digests: Sequence[str], plan: dict[str, JsonValue]
) -> dict[str, JsonValue]:
    """Returns what a job's record holds of a plan, once robots will accept its bundles.

    Args:
        signer: Who vouches, or None.
        job: The job's id.
        digests: Of the bundles.
        plan: The plan as the record holds it.
    """
    if signer is None:
        shown = ", ".join(digest[:12] for digest in digests)
        _LOG.warning("UNSIGNED: %s asks robots to run %s, and nobody's key vouches for it", job, shown)
        return {_PLAN: plan, _TRUST: UNSIGNED}
    for digest in digests:
        signer.admit(digest)
    signature = signer.sign_plan(_bytes(job, plan))
    return {_PLAN: plan, _TRUST: f"signed by {signature.keyid}", _SIGNATURE: signature.model_dump(mode="json")}


def check_recorded_plan(signer: Signer | None, record: JobRecord | None) -> None:
    """Does nothing for a record whose plan, if it has one, is what the signer signed, or when nothing is signed.

    Raises:
        TrustRefused: The plan was changed, was not signed, or by a key that was replaced.
    """
    if signer is None or record is None or _PLAN not in record.detail:
        return
    signature, plan = record.detail.get(_SIGNATURE), record.detail[_PLAN]
    if not isinstance(signature, Mapping) or not isinstance(plan, dict):
        raise TrustRefused(f"the plan of {record.id} is not signed; make a new deployment")
    signer.check_plan(_bytes(record.id, plan), Signature.model_validate(signature))


def is_unsigned(record: JobRecord) -> bool:
    """Returns whether a deployment's record says that it is unsigned."""
    return record.detail.get(_TRUST) == UNSIGNED


def _bytes(job: str, plan: Mapping[str, JsonValue]) -> bytes:
    return canonical_json({"job": job, "plan": dict(plan)})
