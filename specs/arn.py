"""Names of resources: Simyard's own ARNs, RoboMaker's old ones, and plain names.

``arn:simyard:<kind>:<store id>:<path>`` matches RoboMaker's pattern ``arn:.*``. An old
``arn:aws:robomaker:<region>:<account>:<kind>/<path>`` is resolved by its kind and the parts behind it, without the
creation time that RoboMaker appended. RoboMaker's users took ARNs apart at the slash. So over HTTP, where ARNs have
the old form, a simulation job is ``sim-<batch's digits><index>`` and a batch ``sjb-<digits>``; both are understood
anywhere.
"""

import hashlib
import re
from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

from specs.base import Spec
from specs.job_kinds import JOB_KINDS, JobKind

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
_BATCH = JOB_KINDS["simulation-job-batch"].prefix
_BATCH_PATH = re.compile(rf"{_BATCH}-([0-9a-f]{{16}})(?:/(0|[1-9][0-9]*))?")
_OLD_BATCH_NAME = re.compile(r"sjb-([0-9a-f]{16})|sim-([0-9a-f]{16})(0|[1-9][0-9]*)")
_OWN_ARN = re.compile(r"arn:simyard:[a-z-]+:[^\s:'\"]*:[^\s'\",;)\]]*[^\s'\",;)\].]")


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


class ArnForm(NamedTuple):
    """How RoboMaker's clients see the ARNs of a store.

    Attributes:
        store_id: The store's.
        region: Such as ``us-west-2``.
    """

    store_id: str
    region: str

    @property
    def account(self) -> str:
        """Twelve digits, other ones for each store."""
        return f"{int(hashlib.sha256(self.store_id.encode()).hexdigest(), 16) % 10**12:012}"

    @property
    def _before(self) -> str:
        return f"arn:aws:robomaker:{self.region}:{self.account}:"

    def robomakers(self, text: str) -> str:
        """Returns one of Simyard's ARNs in RoboMaker's form; any other text as it is."""
        named = _named(text) if text.startswith("arn:simyard:") else None
        return f"{self._before}{named.kind}/{_old_path(named.path)}" if named and named.path else text

    def own(self, text: str) -> str:
        """Returns an ARN of either form, and of any region and account, as one of this store; other text as it is."""
        named = _named(text)
        return arn(named.kind, self.store_id, named.path) if named and named.kind and named.path else text

    def in_prose(self, text: str) -> str:
        """Returns a text with the ARNs in it in RoboMaker's form."""
        return _OWN_ARN.sub(lambda found: self.robomakers(found[0]), text)


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
        return Reference(kind=None, path=_own_path(text))
    parts = text.split(":", 5)
    if parts[1] == "simyard" and len(parts) >= 5:
        return Reference(kind=_kind(parts[2], text), path=":".join(parts[4:]))
    kind, _, path = parts[-1].partition("/")
    names = path.split("/")
    if len(names) > 1 and _CREATION_TIME.fullmatch(names[-1]):
        names = names[:-1]
    return Reference(kind=_kind(kind, text), path=_own_path("/".join(names)))


def _named(text: str) -> Reference | None:
    try:
        return parse_reference(text)
    except ValueError:
        return None


def _own_path(path: str) -> str:
    found = _OLD_BATCH_NAME.fullmatch(path)
    if not found:
        return path
    batch, of_job, index = found.groups()
    return f"{_BATCH}-{batch}" if batch else f"{_BATCH}-{of_job}/{index}"


def _old_path(path: str) -> str:
    found = _BATCH_PATH.fullmatch(path)
    if not found:
        return path
    return f"sjb-{found[1]}" if found[2] is None else f"sim-{found[1]}{found[2]}"


def _kind(text: str, whole: str) -> ResourceKind:
    for kind in KINDS:
        if text == kind:
            return kind
    raise ValueError(f"{whole!r} names no kind of resource; kinds are {', '.join(KINDS)}")
