"""What a page is made from: the store, who looks, where the pages of resources are, and what lists read of it.

A list reads a page of what it shows, the newest first, however much the store holds.
"""

import re
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from threading import Lock
from typing import TypeVar
from urllib.parse import quote, urlsplit

from specs.arn import ArnForm, Reference, ResourceKind, arn, parse_reference
from specs.errors import (
    DocumentError,
    ObjectNotFound,
    ResourceNotFound,
    StoreAccessDenied,
    StoreError,
    StoreUnreachable,
)
from specs.job_kinds import JobKind
from specs.settings import region
from tasks.gateway.page.content import Cell, Steps
from tasks.storage.base.keys import job_key, jobs_prefix
from tasks.storage.base.store import Store, decode_document
from tasks.storage.jobs.records import JobRecord
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
PAGE_ROWS = 50
MOST_BYTES = 16 << 20
"""More than the record of a batch in ten thousand worlds has."""
_THREADS = 8
_LISTINGS, _KEPT, _LONGEST_KEPT_S = 64, 10, 30.0
T = TypeVar("T")
R = TypeVar("R")


@dataclass
class _Listing:
    names: list[str] = field(default_factory=list[str])
    until_s: float = 0.0
    lock: Lock = field(default_factory=Lock)


class Listings:
    """Names in lists, each list kept for ten times as long as it took to make; many threads may ask at once.

    However often somebody reloads a page, the store is listed for a tenth of the time at most, and a list of a small
    store is always new. Who asks while a list is made gets that one.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, str], _Listing] = OrderedDict()
        self._lock = Lock()

    def names(self, key: tuple[str, str], make: Callable[[], list[str]]) -> list[str]:
        """Returns the names of a list.

        Args:
            key: Which list it is, and whose.
            make: Makes it anew.
        """
        with self._lock:
            kept = self._kept.setdefault(key, _Listing())
            self._kept.move_to_end(key)
            if len(self._kept) > _LISTINGS:
                self._kept.popitem(last=False)
        with kept.lock:
            began_s = time.monotonic()
            if began_s >= kept.until_s:
                kept.names = make()
                now_s = time.monotonic()
                kept.until_s = now_s + min(_KEPT * (now_s - began_s), _LONGEST_KEPT_S)
            return kept.names


@dataclass(frozen=True)
class RequestContext:
    """One look at a page.

    Attributes:
        store: Where everything is.
        store_id: Its id, which is in every ARN.
        may_read: Whether who looks may see the resource of an ARN.
        now_s: The time, seconds since 1970.
        step: Which page of its list is wanted, from 1.
        prefect_url: Says where the pages of the Prefect server are; empty if none is known.
        key: The id of the key of who looks; empty where everybody sees all.
        listings: What lists showed last.
    """

    store: Store
    store_id: str
    may_read: Callable[[str], bool]
    now_s: float
    step: int = 1
    prefect_url: Callable[[], str] = str
    key: str = ""
    listings: Listings = field(default_factory=Listings)

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
    return ResourceNotFound.of(kind, repr(path[:80]), "one that is there", source="page")


def nothing_there() -> DocumentError:
    """Returns what to raise for an address that is nothing's."""
    return DocumentError.of("address", "it", "one that a page links", source="page")


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


def tag_rows(context: RequestContext, kind: ResourceKind, path: str, said: object) -> tuple[tuple[str, Cell], ...]:
    """Returns a row for each tag that a resource has now.

    Args:
        context: Who looks, and where.
        kind: The resource's.
        path: Its path, as in its ARN.
        said: The tags in its record or request; what is no map stands for none.
    """
    made_with = {str(key): str(value) for key, value in said.items()} if isinstance(said, Mapping) else {}
    now = tags_of(context.store, Reference(kind=kind, path=path), made_with)
    return tuple((f"tag {key}", Cell(value)) for key, value in now.items())


def newest_names(context: RequestContext, prefix: str, name_of: Callable[[str], str]) -> list[str]:
    """Returns the names of what lies in a folder, what was written last first; what may not be seen is left out.

    One listing at most, and nothing is read.

    Args:
        context: Who looks, and where.
        prefix: The folder.
        name_of: Returns the name that a key stands for; empty for one that is left out.
    """

    def listed() -> list[str]:
        found = sorted(context.store.entries(prefix), key=lambda entry: (-entry.written_s, entry.key))
        return [name for entry in found if (name := name_of(entry.key))]

    return context.listings.names((prefix, context.key), listed)


def newest_jobs(context: RequestContext, kind: JobKind) -> list[str]:
    """Returns the ids of the jobs of a kind, what was changed last first."""
    folder = f"{jobs_prefix(kind)}/"

    def name_of(key: str) -> str:
        name = key.removeprefix(folder).removesuffix(".json")
        return name if context.may_read(context.arn(kind, name)) else ""

    return newest_names(context, folder.rstrip("/"), name_of)


def step_of(
    context: RequestContext, found: Sequence[T], here: str, rows: int = PAGE_ROWS
) -> tuple[Sequence[T], Steps | None]:
    """Returns the page of a list that is wanted, and where those beside it are; None if it is the only one.

    Args:
        context: Who looks.
        found: All of the list.
        here: The address of the list.
        rows: How many stand on a page.
    """
    first = (context.step - 1) * rows
    shown = found[first : first + rows]
    if len(found) <= rows:
        return shown, None
    words = f"{first + 1:,} to {first + len(shown):,} of {len(found):,}" if shown else f"{len(found):,} in all"
    newer = f"{here}?step={min(context.step - 1, -(-len(found) // rows))}" if context.step > 1 else ""
    return shown, Steps(words, newer, f"{here}?step={context.step + 1}" if first + rows < len(found) else "")


def known_job(store: Store, kind: JobKind, name: str) -> JobRecord | None:
    """Returns the record of a job; None if it is gone or cannot be read, which must not take the list with it.

    Raises:
        StoreUnreachable: The store does not answer.
        StoreAccessDenied: It may not be read.
        DocumentError: The name can be no job's.
    """
    key = job_key(kind, name)
    try:
        return decode_document(JobRecord, store.get(key, MOST_BYTES), store, key)
    except (StoreUnreachable, StoreAccessDenied):
        raise
    except StoreError:
        return None


def job(context: RequestContext, kind: JobKind, name: str) -> JobRecord:
    """Returns the record of a job that may be seen.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    context.require(kind, name)
    found = known_job(context.store, kind, name)
    if found is None:
        raise missing(kind, name)
    return found


def known_jobs(context: RequestContext, kind: JobKind, names: Iterable[str]) -> list[JobRecord]:
    """Returns the records of jobs in the same order, without those that cannot be read."""
    found = at_once(partial(known_job, context.store, kind), names)
    return [record for record in found if record]


def at_once(read: Callable[[T], R], wanted: Iterable[T]) -> list[R]:
    """Returns what is read of each, in the same order; a few are asked for at a time."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(read, wanted))


def read_bytes(store: Store, key: str, most_bytes: int = MOST_BYTES) -> bytes | None:
    """Returns an object; None if there is none."""
    try:
        return store.get(key, most_bytes).body
    except ObjectNotFound:
        return None
