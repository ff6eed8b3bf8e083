"""What a page is made from: the store, who looks, and where the pages of resources are."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from urllib.parse import quote, urlsplit

from specs.arn import ArnForm, Reference, ResourceKind, arn, parse_reference
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound
from specs.settings import region
from tasks.gateway.page.content import Cell
from tasks.storage.base.store import Store
from tasks.storage.tags import tags_of

_FOLDERS: Mapping[str, str] = {
    "pipeline-run": "runs",
    "simulation-job-batch": "batches",
    "world-generation-job": "generations",
    "world-export-job": "exports",
    "world": "worlds",
    "world-template": "templates",
    "robot-application": "applications/robot",
    "simulation-application": "applications/simulation",
    "deployment-fleet": "fleets",
    "robot": "robots",
    "deployment-job": "deployments",
}
SECTIONS = (
    ("Runs", "/runs"),
    ("Batches", "/batches"),
    ("Worlds", "/worlds"),
    ("Generation jobs", "/generations"),
    ("Export jobs", "/exports"),
    ("Templates", "/templates"),
    ("Applications", "/applications"),
    ("Fleets", "/fleets"),
    ("Robots", "/robots"),
    ("Deployments", "/deployments"),
)
_FILE = re.compile(r"(?:file|s3)://[^\s'\",;)]+")


@dataclass(frozen=True)
class Visit:
    """One look at a page.

    Attributes:
        store: Where everything is.
        store_id: Its id, which is in every ARN.
        may_read: Whether who looks may see the resource of an ARN.
        now_s: The time, seconds since 1970.
        step: Which page of its list is wanted, from 1.
        prefect_url: Says where the pages of the Prefect server are; empty if none is known.
    """

    store: Store
    store_id: str
    may_read: Callable[[str], bool]
    now_s: float
    step: int = 1
    prefect_url: Callable[[], str] = str

    def arn(self, kind: ResourceKind, path: str) -> str:
        """Returns the ARN of a resource of the store."""
        return arn(kind, self.store_id, path)

    def arn_rows(self, text: str) -> tuple[tuple[str, Cell], ...]:
        """Returns a row with an ARN as Simyard's commands print it, and one as clients of RoboMaker's API get it."""
        wire = ArnForm(self.store_id, region()).robomakers(text)
        return ("ARN", Cell(text, is_code=True)), ("ARN of the API", Cell(wire, is_code=True))

    def require(self, kind: ResourceKind, path: str) -> None:
        """Lets who may see a resource pass.

        Raises:
            ResourceNotFound: They may not; whether there is one is not told.
        """
        if not self.may_read(self.arn(kind, path)):
            raise missing(kind, path)

    def plain(self, text: str) -> str:
        """Returns a text of the store without places on this machine: of a file, no more than its name."""
        root = urlsplit(self.store.url).path
        short = _FILE.sub(lambda found: f"…/{found[0].rstrip('/').rpartition('/')[2]}", text)
        return short.replace(f"{root}/", "…/") if len(root) > 1 else short


def missing(kind: ResourceKind, path: str) -> ResourceNotFound:
    """Returns what to raise for what is not there."""
    return ResourceNotFound([Fault(path=kind, value=repr(path[:80]), allowed="one that is there")], source="page")


def nothing_there() -> DocumentError:
    """Returns what to raise for an address that is nothing's."""
    return DocumentError([Fault(path="address", value="it", allowed="one that a page links")], source="page")


def address(kind: ResourceKind, path: str) -> str:
    """Returns where the page of a resource is; empty for a kind without one."""
    if kind == "simulation-job":
        batch, _, index = path.partition("/")
        return f"/batches/{quote(batch, safe='')}/jobs/{quote(index, safe='')}"
    folder = _FOLDERS.get(kind)
    return f"/{folder}/{quote(path)}" if folder else ""


def named(text: object, kind: ResourceKind | None = None) -> Cell:
    """Returns the name of what an ARN refers to, with a link to its page.

    Args:
        text: The ARN; anything, because strangers write it.
        kind: What a plain name is of.
    """
    try:
        reference = parse_reference(str(text or ""))
    except ValueError:
        return Cell(str(text))
    found = reference.kind or kind
    return Cell(reference.path, address(found, reference.path) if found and reference.path else "")


def state(text: str) -> Cell:
    """Returns a status or a verdict."""
    return Cell(text, is_state=True)


def when(at_s: float | None) -> Cell:
    """Returns a time; nothing for none."""
    return Cell(at_s=at_s) if at_s else Cell()


def number(value: float | None, unit: str = "", digits: int = 2) -> Cell:
    """Returns a number with its unit; nothing for none."""
    if value is None:
        return Cell(is_number=True)
    text = f"{value:,}" if isinstance(value, int) else f"{value:,.{digits}f}"
    return Cell(f"{text} {unit}".rstrip(), is_number=True)


def tag_rows(visit: Visit, kind: ResourceKind, path: str, said: object) -> tuple[tuple[str, Cell], ...]:
    """Returns a row for each tag that a resource has now.

    Args:
        visit: Who looks, and where.
        kind: The resource's.
        path: Its path, as in its ARN.
        said: The tags in its record or request; what is no map stands for none.
    """
    made_with = {str(key): str(value) for key, value in said.items()} if isinstance(said, Mapping) else {}
    now = tags_of(visit.store, Reference(kind=kind, path=path), made_with)
    return tuple((f"tag {key}", Cell(value)) for key, value in now.items())
