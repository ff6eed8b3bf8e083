"""The chunks of a batch with all that their simulation needs, some of them ready before it is their turn."""

import functools
import logging
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from threading import Lock
from typing import NamedTuple

from specs.arn import ArnForm
from specs.data.episode import EpisodeRequest, Failure
from specs.data.world import World
from specs.errors import SimyardError
from specs.settings import region
from specs.terminal_text import terminal_line
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.data.mounts import Mounts
from tasks.simulate.data.pinned_worlds import pinned_worlds
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.plan.job_variables import job_variables
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.store_url import store_id

logger = logging.getLogger(__name__)
# Deliveries rest for half of a chunk's time: with one chunk ahead lanes would still rest, a third would find none.
_AHEAD = 2
# Chunks are made ready while those before them drive, and asked for again when it is their turn.
_EARLY = 4


class PreparedChunk(NamedTuple):
    """A chunk, and what of it can be simulated.

    Attributes:
        asked: As the plan has it.
        able: The episodes that can be simulated, with the folders of their data sources.
        worlds: Theirs.
        unable: Why others cannot, by index.
    """

    asked: Chunk
    able: Chunk
    worlds: dict[str, World]
    unable: dict[int, Failure]


_early: OrderedDict[tuple[str, str, int], PreparedChunk] = OrderedDict()
_turn = Lock()  # two runs in one process make chunks ready


def prepared_chunk(batch: OpenBatch, number: int, unusable: Mapping[str, Failure]) -> PreparedChunk:
    """Returns a chunk, and what of it can be simulated.

    Args:
        batch: The batch.
        number: The chunk's.
        unusable: Why episodes fail that need an application whose bundle cannot be used, by its digest.
    """
    key = (batch.store.url, batch.id, number)
    with _turn:
        early = None if unusable else _early.get(key)
    if early is not None:
        return early
    chunk, mounted = batch.layout.chunk(number), batch_mounts(batch)
    worlds, missing = load_worlds(batch, chunk.requests)
    why = {
        each.index: missing.get(each.world)
        or mounted.failure(each)
        or unusable.get(each.robot.digest)
        or unusable.get(each.scenario.digest)
        for each in chunk.requests
    }
    unable = {index: failure for index, failure in why.items() if failure}
    able = (mounted.resolved(each) for each in chunk.requests if each.index not in unable)
    found = PreparedChunk(chunk, chunk.model_copy(update={"requests": tuple(able)}), worlds, unable)
    if not unable and not batch.plan.data_sources:  # whose files may be away the next time
        with _turn:
            _early[key] = found
            while len(_early) > _EARLY:
                _early.popitem(last=False)
    return found


def forget_chunks(batch: OpenBatch) -> None:
    """Forgets a batch's chunks that were made ready early, for which nobody is going to ask."""
    with _turn:
        for key in [key for key in _early if key[:2] == (batch.store.url, batch.id)]:
            del _early[key]


def batch_mounts(batch: OpenBatch) -> Mounts:
    """Returns the data sources of a batch on this machine, and what its applications are told of their jobs."""
    variables = functools.partial(job_variables, ArnForm(store_id(batch.store), region()), batch.id)
    return Mounts(batch.store, batch.plan.data_sources, cache_folder() / "data", variables)


def load_worlds(batch: OpenBatch, requests: Iterable[EpisodeRequest]) -> tuple[dict[str, World], dict[str, Failure]]:
    """Returns the episodes' worlds, and why others of them cannot be used."""
    return pinned_worlds(batch.store.url, batch.plan.world_digests, requests)


def chunks_ahead(numbers: Sequence[int]) -> tuple[int, ...]:
    """Returns the chunks to make ready while one drives, of those that are going to be run after it."""
    return tuple(numbers[:_AHEAD])


def coming_chunks(
    batch: OpenBatch, numbers: Iterable[int], unusable: Mapping[str, Failure]
) -> Callable[[], list[PreparedChunk]]:
    """Returns what returns the next chunks of a batch of which anything can be simulated, made ready once.

    What keeps one from being made ready is told to the log, and neither it nor those after it are returned: the chunk
    that drives meanwhile has no part in that.

    Args:
        batch: The batch.
        numbers: Of chunks that are going to be run, in their order.
        unusable: Why episodes fail that need an application whose bundle cannot be used, by its digest.
    """

    @functools.cache
    def coming() -> list[PreparedChunk]:
        return list(_ready_early(batch, numbers, unusable))

    return coming


def _ready_early(
    batch: OpenBatch, numbers: Iterable[int], unusable: Mapping[str, Failure]
) -> Generator[PreparedChunk, None, None]:
    for number in numbers:
        try:
            found = prepared_chunk(batch, number, unusable)
        except (SimyardError, OSError) as exc:  # if it lasts, its own run meets it, and says so
            logger.warning("chunk %d does not begin early: %s", number, terminal_line(str(exc)))
            return
        if not found.able.requests:
            return
        yield found
