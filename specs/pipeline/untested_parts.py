"""What a deployment ships although no episode drove it; the document names it, or the gate ships nothing."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from specs.base import Spec
from specs.field_types import GENERIC_PATTERN, Architecture, EnvironmentVariableKey, text
from specs.robomaker.bundle import Digest
from specs.rules import Finding, part

Reason = Annotated[str, text(1, 255, GENERIC_PATTERN)]


class UntestedBuild(Spec):
    """A build that no episode drove, named by its digest, so that no other can be put in its place.

    Attributes:
        testedAs: The architecture whose build is driven in its place.
        digest: SHA-256 of the bundle, as `simyard app publish` printed it.
    """

    testedAs: Architecture = Field(title="Tested as")
    digest: Digest = Field(title="SHA-256")


UntestedBuilds = dict[Architecture, UntestedBuild]
UntestedVariables = Annotated[dict[EnvironmentVariableKey, Reason], Field(max_length=100)]


def unjudged(deployment: object, gate: object) -> Iterator[Finding]:
    """Yields what a raw deployment names as untested although no gate asks what was tested."""
    for name in ("untestedBuilds", "untestedVariables"):
        if part(deployment, name) is not None and gate is None:
            allowed = "a gate beside it; without one, nothing that ships needs to be tested"
            yield Finding(("deployment", name), part(deployment, name), allowed)
