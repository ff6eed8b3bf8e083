"""Names of resources: Simyard's own ARNs, RoboMaker's old ones, and plain names.

``arn:simyard:<kind>:<store id>:<path>`` matches RoboMaker's pattern ``arn:.*``. An old
``arn:aws:robomaker:<region>:<account>:<kind>/<path>`` is resolved by its kind and the parts behind it, without the
creation time that RoboMaker appended.
"""

import re
from collections.abc import Sequence
from typing import Literal, get_args

from specs.base import Spec
from specs.job_kinds import JobKind

ResourceKind = Literal[
    "world-template",
    "world",
    "robot-application",
    "simulation-application",
    "simulation-job",
    "deployment-fleet",
    "robot",
    JobKind,
]
RUN_KIND: JobKind = "pipeline-run"
"""A run of a document: a kind that RoboMaker does not have."""
KINDS: tuple[ResourceKind, ...] = get_args(ResourceKind)
_CREATION_TIME = re.compile(r"[0-9]{13}")


class Reference(Spec):
    """What a document points at.

    Attributes:
        kind: The kind of resource, or None when only a plain name was given.
        path: The name, or ``<parent>/<name>`` for a world (``<generation>/<world>``) and a simulation job
            (``<batch>/<index>``).
    """

    kind: ResourceKind | None
    path: str


def arn(kind: ResourceKind, store_id: str, path: str) -> str:
    """Returns the ARN of a resource in the store with that id."""
    return f"arn:simyard:{kind}:{store_id}:{path}"


def store_id_of(text: str) -> str:
    """Returns the id of the store that one of Simyard's own ARNs belongs to."""
    return text.split(":", 4)[3]


def resource_kind(text: str) -> ResourceKind | None:
    """Returns the kind of what an ARN names; None for a plain name, and for what is no ARN of a known kind."""
    try:
        return parse_reference(text).kind
    except ValueError:
        return None


def resource_name(text: str) -> str:
    """Returns the path of the resource, or the id of the run, that an ARN names."""
    return parse_reference(text).path


def reference_path(text: str) -> str:
    """Returns what a reference names; one that is malformed stands for itself, and is refused where it is resolved."""
    try:
        return parse_reference(text).path
    except ValueError:
        return text


def list_name(kind: ResourceKind) -> str:
    """Returns what `simyard list` calls the resources of a kind."""
    word = kind.removeprefix("deployment-") if kind == "deployment-fleet" else kind
    return f"{word}es" if word.endswith("batch") else f"{word}s"


def absence(kinds: Sequence[ResourceKind], store_url: str, near: Sequence[str] = ()) -> str:
    """Returns what to say of a name that no resource of these kinds has in a store.

    Args:
        kinds: Those that it could be of.
        store_url: Where it was looked for.
        near: What is there and is called nearly so.
    """
    hint = f"; near it: {', '.join(near)}" if near else ""
    listed = list_name(kinds[0]) if len(kinds) == 1 else "KIND"
    return f"not in the store {store_url}{hint}; simyard list {listed} shows what is there"


def parse_reference(text: str) -> Reference:
    """Returns what an ARN (ours or RoboMaker's) or a plain name refers to.

    Raises:
        ValueError: For an ARN whose kind is not one of RoboMaker's.
    """
    if not text.startswith("arn:"):
        return Reference(kind=None, path=text)
    parts = text.split(":", 5)
    if parts[1] == "simyard" and len(parts) >= 5:
        return Reference(kind=_kind(parts[2], text), path=":".join(parts[4:]))
    kind, _, path = parts[-1].partition("/")
    names = path.split("/")
    if len(names) > 1 and _CREATION_TIME.fullmatch(names[-1]):
        names = names[:-1]
    return Reference(kind=_kind(kind, text), path="/".join(names))


def _kind(text: str, whole: str) -> ResourceKind:
    for kind in KINDS:
        if text == kind:
            return kind
    raise ValueError(f"{whole!r} names no kind of resource; kinds are {', '.join(KINDS)}")
