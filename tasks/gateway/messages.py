"""A request as it came over the wire, and the answer to it."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class HttpRequest:
    """A request, unchanged, as its signature needs it.

    Attributes:
        method: Such as ``POST``.
        raw_path: Still percent-encoded: ARNs in it have slashes that a decoded path would be split at.
        query: Still encoded, without the question mark; empty if there is none.
        headers: Names in lower case, and values, in their order; a name may come several times.
        body: All of it.
        client: The address that it came from.
        id: A new one for each; the answer and the log of actions have it, too.
    """

    method: str
    raw_path: str
    query: str
    headers: tuple[tuple[str, str], ...]
    body: bytes
    client: str = ""
    id: str = ""


@dataclass(frozen=True)
class HttpAnswer:
    """What is sent back.

    Attributes:
        status: HTTP's.
        body: All of it.
        content_type: Of the body.
        error: RoboMaker's code, such as ``ResourceNotFoundException``; empty if it is none.
        headers: Beside content type and length.
    """

    status: int
    body: bytes
    content_type: str = "application/json"
    error: str = ""
    headers: Mapping[str, str] = field(default_factory=dict[str, str])
