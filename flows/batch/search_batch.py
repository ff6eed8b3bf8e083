"""`simyard.search`: how probable a failure is where a batch's variables are distributed as the robot will meet them.

Each step's answers are an object of the store, by the digest of what is searched for. Everything else follows from
them, so that a search that was killed goes on where it was, and one that is asked for again reads what it found.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.special import ndtr, ndtri

from flows.batch.replay_episode import bundles
from specs.base import Fault, Spec, digest
from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound, StageFailed
from specs.pipeline.search_section import Distribution, Search
from tasks.progress.listener import report_progress
from tasks.results.gate.missing_data import ROBOTS_OWN
from tasks.results.statistics.rare_failures import (
    FAILED,
    FailureProbability,
    Particles,
    Space,
    failure_probability,
)
from tasks.simulate.batch.batch_record import KIND, OpenBatch, load_batch
from tasks.simulate.batch.chunk_run import ChunkRunner, load_worlds
from tasks.simulate.plan.batch_plan import DEFAULT_LANES
from tasks.simulate.replay.replay_run import resimulate
from tasks.storage.base.keys import search_step_key
from tasks.storage.base.store import Store, create_once
from tasks.storage.resource_names import find_batch_name

# Of the algorithm and of how episodes are drawn: another one has other steps.
_FORM = 1
_SEEDS = 2**32
FAILURES_KEPT = 100


class FoundFailure(NamedTuple):
    """An episode that failed in a search, with all that it takes to drive it again.

    Attributes:
        world: ``<generation>/<world>``.
        seed: As a batch's matrix names it.
        environment: The variables that were varied.
        reason: Why it failed.
    """

    world: str
    seed: int
    environment: Mapping[str, str]
    reason: str


class SearchResult(NamedTuple):
    """What a search found.

    Attributes:
        batch: The batch that was searched.
        probability: How probable a failure is.
        failures: Those that were found, each once, in the order in which they were, ``FAILURES_KEPT`` at most.
        failed: How many were found in all.
        simulated: How many episodes were simulated now; the others were in the store.
    """

    batch: str
    probability: FailureProbability
    failures: tuple[FoundFailure, ...]
    failed: int
    simulated: int


def search_batch(store: Store, text: str, search: Search) -> SearchResult:
    """Returns how probable a failure is in episodes like a batch's, and the failures that were found.

    Args:
        store: Where the batch is.
        text: ARN or id of the batch, of one of its jobs, or of a run of a document.
        search: What is varied, and how many episodes may be simulated.

    Raises:
        ResourceNotFound: There is no such batch, or what it needs is gone.
        DocumentError: The batch has several requests, or does not have the variables.
        StageFailed: An episode did not come to an end of its own.
    """
    batch = load_batch(store, find_batch_name(store, text))
    drawn = _DrawnEpisodes(batch, search)
    steps = _Steps(batch, search, drawn)
    going = failure_probability(drawn.space, budget=search.episodes, confidence=search.confidence, seed=search.seed)
    particles = next(going)
    while True:
        answers = steps.answers(particles)
        scores = np.array([math.inf if each is None else each for each in answers.scores])
        try:
            particles = going.send(scores)
        except StopIteration as end:
            return SearchResult(batch.id, end.value, steps.found(), steps.failed, steps.simulated)


class _DrawnEpisodes:
    """Episodes like a batch's, drawn as a search says.

    Attributes:
        space: Its smooth coordinates are the numbers; the others are the choices, the world and the seed.
    """

    def __init__(self, batch: OpenBatch, search: Search) -> None:
        """Takes the batch's request, whose variables are to be varied.

        Raises:
            DocumentError: The batch has several requests, or does not have the variables.
            ResourceNotFound: A world is gone.
        """
        self._first, plan = batch.layout.request(0), batch.plan
        self.episodes = batch.layout.episodes
        known = self._first.environment
        unknown = [name for name in search.over if name not in known]
        allowed = f"a variable that the batch's request or matrix sets: {', '.join(sorted(known)) or 'there is none'}"
        refused = [Fault(path=f"over.{name}", value=name, allowed=allowed) for name in unknown]
        template, *others = plan.templates
        if others:
            one = "a batch of one request: which of several is to be searched is not said"
            refused.append(Fault(path=KIND, value=batch.id, allowed=one))
        if refused:
            raise DocumentError(refused, "simyard")
        self._worlds = plan.worlds_of(template)
        requests = [self._first.model_copy(update={"world": world}) for world in self._worlds]
        if missing := load_worlds(batch, requests)[1]:
            world, why = next(iter(missing.items()))
            raise ResourceNotFound.of("world", world, f"one that is there: {why}", source="simyard")
        self._over = dict(sorted(search.over.items()))
        self._smooth = [name for name, each in self._over.items() if each.choice is None]
        self._choices = [name for name, each in self._over.items() if each.choice is not None]
        self.space = Space(len(self._smooth), len(self._choices) + 2)

    def requests(self, particles: Particles) -> list[EpisodeRequest]:
        """Returns the episodes of particles; their indices follow those of the batch."""
        columns = {name: _values(self._over[name], particles.smooth[:, at]) for at, name in enumerate(self._smooth)}
        for at, name in enumerate(self._choices):
            columns[name] = _chosen(self._over[name].choice or (), particles.drawn[:, at])
        world, seed = (particles.drawn[:, at].tolist() for at in (-2, -1))
        return [
            self._request(row, self._worlds[int(world[row] * len(self._worlds))], int(seed[row] * _SEEDS), columns)
            for row in range(len(seed))
        ]

    def _request(self, row: int, world: str, seed: int, columns: Mapping[str, Sequence[str]]) -> EpisodeRequest:
        own = {name: values[row] for name, values in columns.items()}
        judges = self._first.judge_environment
        return self._first.model_copy(
            update={
                "index": self.episodes + row,
                "world": world,
                "seed": seed,
                "environment": {**self._first.environment, **own},
                "judge_environment": judges and {**judges, **own},
            }
        )


def _chosen(options: Sequence[str], drawn: Float64[np.ndarray, "episodes"]) -> list[str]:
    return [options[int(place * len(options))] for place in drawn.tolist()]


def _values(over: Distribution, smooth: Float64[np.ndarray, "episodes"]) -> list[str]:
    """Returns the values of a variable for standard normal numbers."""
    if over.uniform:
        low, high = over.uniform
        numbers = low + (high - low) * ndtr(smooth)
    elif over.logUniform:
        low, high = (math.log(each) for each in over.logUniform)
        numbers = np.exp(low + (high - low) * ndtr(smooth))
    else:
        assert over.normal is not None  # noqa: S101 - one of the four is given
        mean, sd = over.normal.mean, over.normal.sd
        least = -math.inf if over.normal.atLeast is None else (over.normal.atLeast - mean) / sd
        most = math.inf if over.normal.atMost is None else (over.normal.atMost - mean) / sd
        whole = math.isinf(least) and math.isinf(most)
        cut = smooth if whole else ndtri(ndtr(least) + (ndtr(most) - ndtr(least)) * ndtr(smooth))
        numbers = mean + sd * np.clip(cut, least, most)
    return [f"{number:.9g}" for number in numbers.tolist()]


class _Asked(Spec):
    """What the answers of a search's steps follow from."""

    form: int
    plan: str
    search: Search


class _Answers(Spec):
    """What came of a step's episodes, in their order.

    Attributes:
        scores: How far each was from failing; None where that is not known.
        reasons: Why episodes failed, by their place.
    """

    scores: tuple[float | None, ...]
    reasons: dict[int, str]


class _Steps:
    """The steps of a search, each simulated once.

    Attributes:
        failed: How many episodes failed.
        simulated: How many were simulated now.
    """

    def __init__(self, batch: OpenBatch, search: Search, drawn: _DrawnEpisodes) -> None:
        self.failed = self.simulated = 0
        self._batch, self._search, self._drawn = batch, search, drawn
        self._digest = digest(_Asked(form=_FORM, plan=batch.layout.plan_digest, search=search))
        self._number = self._done = 0
        self._found: dict[tuple[str, int, tuple[tuple[str, str], ...]], str] = {}
        self._bundles: Mapping[str, Path] | None = None

    def found(self) -> tuple[FoundFailure, ...]:
        """Returns the failures that were found, each once."""
        return tuple(FoundFailure(world, seed, dict(own), why) for (world, seed, own), why in self._found.items())

    def answers(self, particles: Particles) -> _Answers:
        """Returns what came of the next step, from the store if it is there."""
        report_progress("Episodes", self._done, self._search.episodes)
        requests = self._drawn.requests(particles)
        store, key = self._batch.store, search_step_key(self._batch.id, self._digest, self._number)
        try:
            answers = _Answers.model_validate_json(store.get(key).body)
        except ObjectNotFound:
            answers = self._simulated(requests)
            create_once(store, key, answers.model_dump_json().encode())
            self.simulated += len(requests)
        self._number += 1
        self._done += len(requests)
        self.failed += len(answers.reasons)
        for place, why in answers.reasons.items():
            if len(self._found) < FAILURES_KEPT:
                own = tuple((name, requests[place].environment[name]) for name in sorted(self._search.over))
                self._found.setdefault((requests[place].world, requests[place].seed, own), why)
        return answers

    def _simulated(self, requests: Sequence[EpisodeRequest]) -> _Answers:
        if self._bundles is None:
            self._bundles = bundles(self._batch)
        plan = self._batch.plan
        runner = ChunkRunner(self._bundles, plan.engine, plan.recordings.rateHz, lambda _: None)
        rows = resimulate(self._batch, requests, runner.run, max(plan.lanes, DEFAULT_LANES))
        scores = [self._score(row) for row in rows]
        return _Answers(
            scores=tuple(scores),
            reasons={
                place: reason(rows[place]) or self._search.measure
                for place, score in enumerate(scores)
                if score == FAILED
            },
        )

    def _score(self, row: EpisodeResult) -> float | None:
        """Returns how far an episode was from failing: its measure, or that it failed.

        Raises:
            StageFailed: It is not the robot that did not end it.
        """
        passed = success(row)
        if passed is None or (row.status == "Failed" and row.failure_code not in ROBOTS_OWN):
            raise StageFailed(row.failure_code or "Canceled", f"an episode of the search: {row.failure_reason}")
        value = getattr(row, self._search.measure)
        if not passed or (value is not None and value < 0.0):
            return FAILED
        return None if value is None or math.isnan(value) else float(value)
