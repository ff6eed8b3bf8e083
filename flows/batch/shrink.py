"""`simyard shrink`: the smallest world and the lowest seed in which a job still fails in the same way."""

import hashlib
from collections.abc import Sequence
from typing import NamedTuple

from flows.batch.replay_episode import bundles
from specs.base import Fault
from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from specs.data.world import World
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from specs.template.body import TemplateBody
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.batch.commit import load_worlds
from tasks.simulate.batch.job import OpenBatch, job_of
from tasks.simulate.replay.delta_debugging import Names, minimize_selection
from tasks.simulate.replay.trials import Trial, simulate_trials
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_resource
from tasks.storage.worlds import encode_world, write_world
from tasks.worlds.certificate.certificate import broken_guarantees
from tasks.worlds.certificate.furniture_removal import SHRUNK, keep_furniture

# Seeds that are looked at below the job's own; simulated together.
_SEEDS_AT_MOST = 64
_DIGEST_SHOWN = 8


class ShrunkJob(NamedTuple):
    """A job that fails, and a smaller one that fails in the same way.

    Attributes:
        batch: The job's batch.
        job: ``<batch>/<index>``.
        reason: How both fail, in a word or two.
        request, world, row: The job, where it took place, and what came of it.
        small_request, small_world, small_row: The same of the smaller one, whose world is in the store.
        episodes: How many were simulated.
        minimal: Whether no piece of furniture can be left out by itself.
        broken: What the smaller world does not guarantee, one sentence each.
    """

    batch: OpenBatch
    job: str
    reason: str
    request: EpisodeRequest
    world: World
    row: EpisodeResult
    small_request: EpisodeRequest
    small_world: World
    small_row: EpisodeResult
    episodes: int
    minimal: bool
    broken: tuple[str, ...]


def shrink_job(store: Store, text: str, budget: int) -> ShrunkJob:
    """Returns the smaller job of a simulation job, by its ARN or ``<batch>/<index>``; its world is put into the store.

    Args:
        store: Where the job's batch is.
        text: Names the job.
        budget: How many episodes may be simulated; at least 2.

    Raises:
        ResourceNotFound: There is no such job, or what it needs is gone.
        DocumentError: The job did not fail, or does not fail again.
    """
    batch, index = job_of(store, find_resource(store, text, ("simulation-job",)).path)
    search = _Search(batch, index, _failed_row(batch, index))
    (again,) = search.rows([Trial(search.world, search.request.seed)])
    if not search.is_same(again):
        allowed = f"one that fails again: it is {reason(again) or 'passed'} now; simyard replay says what deviates"
        raise _refused(batch, index, allowed)
    found = minimize_selection(tuple(piece.name for piece in search.world.furniture), search.still_fails, budget - 2)
    seed = search.lowest_seed(search.furnished(found.names), budget - 1)
    world = _store_world(store, search.furnished(found.names), batch, index)
    (row,) = search.rows([Trial(world, seed)])
    return ShrunkJob(
        batch=batch,
        job=f"{batch.id}/{index}",
        reason=reason(search.row),
        request=search.request,
        world=search.world,
        row=search.row,
        small_request=search.request.model_copy(update={"world": f"{world.generation}/{world.name}", "seed": seed}),
        small_world=world,
        small_row=row,
        episodes=search.simulated,
        minimal=found.minimal,
        broken=broken_guarantees(world.certificate),
    )


class _Search:
    """Episodes like one that failed, and how many of them were simulated."""

    def __init__(self, batch: OpenBatch, index: int, row: EpisodeResult) -> None:
        self.batch, self.row, self.simulated = batch, row, 0
        self.request = batch.layout.request(index)
        worlds, missing = load_worlds(batch, [self.request])
        if missing:
            allowed = f"one whose world is there: {missing[self.request.world]}"
            raise ResourceNotFound([_fault(batch, index, allowed)], "simyard")
        self.world = worlds[self.request.world]
        self._template, self._bundles = _template(batch.store, self.world), bundles(batch)

    def rows(self, trials: Sequence[Trial]) -> list[EpisodeResult]:
        self.simulated += len(trials)
        return simulate_trials(self.batch, self.request, trials, self._bundles, engine=self.row.engine)

    def is_same(self, row: EpisodeResult) -> bool:
        """Returns whether an episode fails in the same way."""
        return (row.status, row.failure_code, row.outcome_reason) == (
            self.row.status,
            self.row.failure_code,
            self.row.outcome_reason,
        )

    def furnished(self, names: Names) -> World:
        return keep_furniture(self.world, names, self._template)

    def still_fails(self, selections: Sequence[Names]) -> list[bool]:
        trials = [Trial(self.furnished(names), self.request.seed) for names in selections]
        return [self.is_same(row) for row in self.rows(trials)]

    def lowest_seed(self, world: World, budget: int) -> int:
        """Returns the lowest seed that still fails, of those that the budget lets it try; the job's own at worst."""
        seeds = range(min(self.request.seed, _SEEDS_AT_MOST, max(0, budget - self.simulated)))
        rows = self.rows([Trial(world, seed) for seed in seeds])
        return next((seed for seed, row in zip(seeds, rows, strict=True) if self.is_same(row)), self.request.seed)


def _failed_row(batch: OpenBatch, index: int) -> EpisodeResult:
    rows = committed_chunk(batch.store, batch.id, batch.layout.chunk_of(index)) or ()
    row = next((row for row in rows if row.index == index), None)
    if row is None or success(row) is not False:
        state = "has no result yet" if row is None else reason(row) or "passed"
        raise _refused(batch, index, f"a job that failed; this one {state}")
    return row


def _template(store: Store, world: World) -> TemplateBody | None:
    """Returns what a world was made from, if the store has it."""
    try:
        return TemplateBody.model_validate_json(store.get(template_key(world.template_digest)).body)
    except (DocumentError, ObjectNotFound):  # hand-made worlds name no template
        return None


def _store_world(store: Store, world: World, batch: OpenBatch, index: int) -> World:
    """Puts a world into the store under a name made from its content, and returns it; it may be there already."""
    bare = world.model_copy(update={"generation": SHRUNK, "name": f"{batch.id}-{index}"})
    digest = hashlib.sha256(encode_world(bare)).hexdigest()[:_DIGEST_SHOWN]
    found = bare.model_copy(update={"name": f"{bare.name}-{digest}"})
    write_world(store, f"{SHRUNK}/{found.name}", encode_world(found))
    return found


def _refused(batch: OpenBatch, index: int, allowed: str) -> DocumentError:
    return DocumentError([_fault(batch, index, allowed)], "simyard")


def _fault(batch: OpenBatch, index: int, allowed: str) -> Fault:
    return Fault(path="simulation-job", value=f"{batch.id}/{index}", allowed=allowed)
