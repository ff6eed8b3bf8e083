"""Decides whether a deployment is signed, and with which keys, before anything runs. Imports nothing heavy."""

import os
from pathlib import Path

from specs.base import Fault
from specs.field_types import S3Object

KEYS_VARIABLE = "SIMYARD_KEYS"
UNSIGNED_ALARM = (
    "UNSIGNED: nobody's key vouches for this deployment; whoever can write to the store could have made it."
)


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
