"""Names on the command line: an ARN of the one kind that the command takes, or the bare name."""

from specs.arn import ResourceKind, parse_reference
from specs.base import Fault
from specs.errors import DocumentError


def resource_path(text: str, kind: ResourceKind) -> str:
    """Returns what an ARN or a plain name names, such as ``<batch>/<index>`` for a simulation job.

    Raises:
        DocumentError: It is the ARN of something else.
    """
    try:
        reference = parse_reference(text)
    except ValueError as exc:
        raise _refused(text, str(exc)) from exc
    if reference.kind not in {None, kind}:
        raise _refused(text, f"an ARN of a {kind}")
    return reference.path


def _refused(text: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(text), allowed=allowed)], source="simyard")
