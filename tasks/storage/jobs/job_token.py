"""What a store keeps of a client request token, and what is told when it comes with another request."""

from specs.base import Fault, Spec
from specs.errors import IdempotentParameterMismatch
from specs.job_kinds import JobKind


class JobToken(Spec):
    """A token, and which job it made of which request.

    Attributes:
        request_digest: SHA-256 of the request's canonical JSON.
        id: The job's.
    """

    token: str
    request_digest: str
    id: str


def token_mismatch(kind: JobKind, known: JobToken, digest: str, changes: str) -> IdempotentParameterMismatch:
    """Returns the refusal of a token that came before with another request.

    Args:
        kind: The kind of job.
        known: What the token stands for.
        digest: Of the request that comes now.
        changes: What differs; empty where the first request is not known any more.
    """
    what = f": {changes}" if changes else ""
    digests = f"request {known.request_digest}, now {digest}"
    allowed = f"came before with another request ({known.id}){what}; send the same one, or another token ({digests})"
    return IdempotentParameterMismatch(
        [Fault(path="clientRequestToken", value=repr(known.token), allowed=allowed)], source=kind
    )
