"""A search over a batch: how probable a failure is where its variables are distributed as the robot will meet them.

The section ``search`` of a document and `simyard.search` run it. Each step's answers are an object of the store, by the
digest of what is searched for, with its owner's MAC. Everything else follows from them, so that a search that was
killed goes on where it was, one that is asked for again reads what it found, and no answer counts that somebody else
has written: such a step is simulated anew and compared (docs/decisions/0010).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float64

from flows.batch.replay_episode import JobReplay, bundles, playback, unpacked
from flows.batch.search_episodes import DriveEpisodes, drive_episodes, is_canceled, score_of, why_failed
from specs.base import Fault, Spec, canonical_document, canonical_json, digest
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.physics import PHYSICAL, no_such_people, step_of
from specs.errors import DocumentError, ResourceNotFound, StageFailed
from specs.pipeline.search_section import Distribution, Search, SearchFind
from tasks.applications.registry import resolve
from tasks.progress.listener import report_progress
from tasks.results.playback.playback import ColumnDeviation
from tasks.results.statistics.distinct_failures import (
    GENERATION,
    FailureTraits,
    counts_of_nearest,
    farthest_first,
    near_failures,
)
from tasks.results.statistics.failure_causes import PARTS, WORLD, Factor, failure_causes
from tasks.results.statistics.found_failures import BatchSearch, FoundFailure, read_search
from tasks.results.statistics.particles import Particles, Space
from tasks.results.statistics.rare_failures import Estimated, failure_probability
from tasks.simulate.batch.batch_record import KIND, OpenBatch, load_batch
from tasks.simulate.batch.chunk_run import load_worlds
from tasks.simulate.engines.engine_table import REFERENCE
from tasks.simulate.replay.replay_run import replay_request
from tasks.storage.base.keys import search_step_key
from tasks.storage.base.store import Store, create_once, encode_document, find_document
from tasks.storage.resource_names import find_batch_name
from tasks.storage.store_url import open_store

STAGE, CONFIRMED = "Search", "Failures confirmed"
# Of the algorithm and of how episodes are drawn: another one has other steps.
_FORM = 5
_SEEDS = 2**32
# The score of an episode that fails with the other version, too: no failure, and nothing is nearer to one.
_NEAREST = 0.0
# Of those that are to be reported, so many times as many are driven again where some vanish.
_TRIES = 3


class SearchResult(NamedTuple):
    """What a search came to.

    Attributes:
        found: The probability and the failures.
        simulated: How many episodes were simulated now; the others were in the store.
    """

    found: BatchSearch
    simulated: int


class SearchWorkers(Protocol):
    """Workers of a cluster that drive the episodes of a search (``flows.batch.search_batch``)."""

    def __call__(self, batch: OpenBatch, run: str, search: Callable[[DriveEpisodes], SearchResult]) -> SearchResult:
        """Returns what a search came to whose episodes the workers drive.

        Args:
            batch: The batch.
            run: As for `search_batch`.
            search: Searches, given what drives episodes.
        """
        ...


def search_batch(
    store_url: str, batch: str, search: Search, run: str = "", *, workers: SearchWorkers | None = None
) -> SearchResult:
    """Returns how probable a failure is in episodes like a batch's, and the failures that were found.

    Args:
        store_url: Where the batch is.
        batch: Its id.
        search: What is varied, and how many episodes may be simulated.
        run: Id of the run of a document that the search is a stage of; empty if it is of none.
        workers: Drive the episodes, where there are any; they are not asked for where all steps are in the store.

    Raises:
        ResourceNotFound: There is no such batch, or what it needs is gone.
        DocumentError: The batch has several requests, or does not have the variables.
        StageFailed: An episode did not come to an end of its own, somebody has cancelled the run, or a step in the
            store is not what the simulation gives.
    """
    opened = load_batch(open_store(store_url), batch)
    if workers is None:
        return _run_search(opened, search, run)
    try:
        return _run_search(opened, search, run, may_simulate=False)
    except _NotSimulatedError:
        return workers(opened, run, lambda drive: _run_search(opened, search, run, drive))


def stored_search(store: Store, batch: str, search: Search) -> BatchSearch | None:
    """Returns what a search found that was simulated before; None where a step of it is not there.

    Raises:
        ResourceNotFound: There is no such batch, or a world of it is gone.
        DocumentError: The batch has several requests, or does not have the variables.
    """
    try:
        return _run_search(load_batch(store, batch), search, may_simulate=False).found
    except _NotSimulatedError:
        return None


class _NotSimulatedError(Exception):
    """A step is to be simulated, and must not be."""


def _run_search(
    opened: OpenBatch, search: Search, run: str = "", drive: DriveEpisodes | None = None, *, may_simulate: bool = True
) -> SearchResult:
    """Returns what a search over a batch found; see `search_batch`."""
    drawn = DrawnEpisodes(opened, search)
    steps = SearchSteps(opened, search, drawn, run, drive, may_simulate=may_simulate)
    estimated = steps.estimate()
    steps.explore()
    likely, distinct = estimated.probability, steps.distinct()
    found = BatchSearch(
        batch=opened.id,
        search=search,
        probability=likely.model_copy(update={"against": search.against}),
        causes=failure_causes(estimated.seen, drawn.factors(), likely.estimate, search.estimate.confidence),
        failures=tuple(each for each in distinct if each.confirmed),
        vanished=tuple(each for each in distinct if not each.confirmed),
        failed=steps.failed,
        common=steps.common,
    )
    return SearchResult(found, steps.simulated)


def replay_found(store: Store, text: str, number: int) -> JobReplay:
    """Returns a failure that the search of a batch's document has found, simulated once more.

    Args:
        store: Where the batch is.
        text: ARN or id of the batch, of one of its jobs, or of a run of a document.
        number: The failure's, from 1.

    Raises:
        ResourceNotFound: There is no such batch, or what it needs is gone.
        DocumentError: Its document has searched for nothing, or has found fewer.
    """
    batch = load_batch(store, find_batch_name(store, text))
    search = read_search(store, batch.id)
    if search is None or not 0 < number <= len(search.numbered):
        kept = len(search.numbered) if search else 0
        allowed = f"1 to {kept}" if kept else "no number: no search of its document has found a failure"
        raise DocumentError.of("--found", str(number), allowed, source="simyard")
    asked, name, folders = search.numbered[number - 1], f"{batch.id}/found-{number}", bundles(batch)
    request = found_request(batch, asked)
    again = replay_request(batch, request, folders)
    row, robot = again.driven.row, folders[request.robot.digest]
    why = why_failed(row, search.search.measure)
    same, shown = why == asked.reason, playback(batch.id, again, robot)
    return JobReplay(
        job=name,
        world=again.world,
        ending=why or row.outcome,
        deviations=(
            ColumnDeviation(
                column="reason",
                unit="",
                recorded=asked.reason,
                replayed=why or "none: it passed",
                same=same,
                most=0.0 if same else math.inf,
            ),
        ),
        causes=(),
        playback=replace(shown, job=name) if shown else None,
        robot=robot,
        traffic=again.driven.traffic,
    )


def found_request(batch: OpenBatch, failure: FoundFailure) -> EpisodeRequest:
    """Returns the episode of a failure that a search over a batch has found; its index follows those of the batch."""
    own = failure.environment
    return _like(batch.layout.request(0), batch.layout.episodes, failure.world, failure.seed, own)


def _like(first: EpisodeRequest, index: int, world: str, seed: int, own: Mapping[str, str]) -> EpisodeRequest:
    judges = first.judge_environment
    return first.model_copy(
        update={
            "index": index,
            "world": world,
            "seed": seed,
            "environment": {**first.environment, **own},
            "judge_environment": judges and {**judges, **own},
        }
    )


class DrawnEpisodes:
    """Episodes like a batch's, drawn as a search says.

    Attributes:
        space: Its smooth coordinates are the numbers; the others are the choices, the world and the seed.
        options: How many values each of the others has.
        other: The version that the search is against; None if it is against none.
    """

    def __init__(self, batch: OpenBatch, search: Search) -> None:
        """Takes the batch's request, whose variables are to be varied.

        Raises:
            DocumentError: The batch has several requests, does not have the variables, or its robot has another hull
                than the version that the search is against.
            ResourceNotFound: A world is gone.
        """
        self._first, plan = batch.layout.request(0), batch.plan
        self.episodes = batch.layout.episodes
        known = self._first.environment
        unknown = [name for name in search.over if name not in known and name not in PHYSICAL]
        allowed = f"a variable that the batch's request or matrix sets: {', '.join(sorted(known)) or 'there is none'}"
        refused = [Fault(path=f"over.{name}", value=name, allowed=allowed) for name in unknown]
        people = no_such_people(search.over, plan.people)
        refused += [Fault(path=f"over.{name}", value=name, allowed=instead) for name, instead in people]
        self.other = None if search.against is None else self._other_version(batch.store, search.against)
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
        self.options = (*(len(self._over[name].choice or ()) for name in self._choices), len(self._worlds), _SEEDS)
        self.space = Space(len(self._smooth), len(self.options), self.options[:-1])

    def _other_version(self, store: Store, number: str) -> ApplicationLaunch:
        """Returns how another version of the robot application is launched: as the batch's is.

        Raises:
            ResourceNotFound: There is no such version.
            DocumentError: It has another hull, and so other starts and goals with the same seed.
        """
        robot = self._first.robot
        version = resolve(store, "robot-application", robot.name, number)
        builds = {each.architecture: each.digest for each in version.builds}
        digest = builds.get(robot.architecture or "X86_64", version.digest)
        own, other = (_hull(store, each) for each in (robot.digest, digest))
        if own != other:
            same = f"a version with the batch's hull, {own}: with its own, {other}, it begins and goes elsewhere"
            raise DocumentError.of("against", number, same, source="simyard")
        return robot.model_copy(update={"version": number, "digest": digest})

    def requests(self, particles: Particles) -> list[EpisodeRequest]:
        """Returns the episodes of particles; their indices follow those of the batch."""
        columns = {
            name: _whole_steps(_values(self._over[name], particles.smooth[:, at], step_of(name)), step_of(name))
            for at, name in enumerate(self._smooth)
        }
        for at, name in enumerate(self._choices):
            columns[name] = _chosen(self._over[name].choice or (), particles.drawn[:, at])
        world, seed = (particles.drawn[:, at].tolist() for at in (-2, -1))
        return [
            _like(
                self._first,
                self.episodes + row,
                self._worlds[int(world[row] * len(self._worlds))],
                int(seed[row] * _SEEDS),
                {name: values[row] for name, values in columns.items()},
            )
            for row in range(len(seed))
        ]

    def factors(self) -> list[Factor]:
        """Returns what varies, but for the seed, in the order of the space's coordinates."""
        from scipy.special import ndtri  # noqa: PLC0415 - it takes long to load

        bounds = ndtri(np.arange(1, PARTS) / PARTS)
        numbers = [
            Factor(name, _parts(_values(self._over[name], bounds, step_of(name))), number=True) for name in self._smooth
        ]
        choices = [Factor(name, self._over[name].choice or (), number=False) for name in self._choices]
        worlds = [Factor(WORLD, tuple(self._worlds), number=False)] if len(self._worlds) > 1 else []
        return [*numbers, *choices, *worlds]

    def traits(self, particles: Particles, failures: "Sequence[_Failed]") -> FailureTraits:
        """Returns by what failures are told apart."""
        from scipy.special import ndtr  # noqa: PLC0415 - it takes long to load

        reasons = {why: number for number, why in enumerate(dict.fromkeys(each.reason for each in failures))}
        places = (particles.drawn * self.options).astype(np.int64)
        return FailureTraits(
            reason=np.array([reasons[each.reason] for each in failures], np.int64),
            world=places[:, -2],
            seed=places[:, -1],
            place_m=np.array([each.place_m for each in failures], np.float64).reshape(-1, 2),
            numbers=ndtr(particles.smooth),
            choices=places[:, :-2],
        )


def _hull(store: Store, digest: str) -> str:
    """Returns how wide and how high a robot is, which its floor, starts and goals follow from, for a person."""
    from tasks.simulate.application.robot_file import read_robot_mjcf  # noqa: PLC0415 - it loads MuJoCo
    from tasks.simulate.application.robot_model import compile_robot, hull_of  # noqa: PLC0415 - likewise

    hull = hull_of(compile_robot(read_robot_mjcf(unpacked(store, [digest])[digest] / "robot.xml")))
    return f"{hull.radius_m:.9g} m around and from {hull.low_m:.9g} to {hull.high_m:.9g} m high"


def _chosen(options: Sequence[str], drawn: Float64[np.ndarray, "episodes"]) -> list[str]:
    return [options[int(place * len(options))] for place in drawn.tolist()]


def _parts(bounds: Sequence[str]) -> tuple[str, ...]:
    """Returns the parts between bounds, and those below and above all, for a person."""
    shown = [f"{float(each):.4g}" for each in bounds]
    between = [f"{low} to {high}" for low, high in pairwise(shown)]
    return (f"below {shown[0]}", *between, f"above {shown[-1]}")


def _whole_steps(values: Sequence[str], step: float) -> Sequence[str]:
    """Returns the nearest values that a variable may have."""
    return [f"{round(float(each) / step) * step:.9g}" for each in values] if step else values


def _values(over: Distribution, smooth: Float64[np.ndarray, "episodes"], step: float = 0.0) -> list[str]:
    """Returns the values of a variable for standard normal numbers; those on a uniform one's steps are as likely."""
    from scipy.special import ndtr, ndtri  # noqa: PLC0415 - it takes long to load

    if over.uniform:
        low, high = over.uniform
        numbers = np.clip(low - step / 2 + (high - low + step) * ndtr(smooth), low, high)
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
    part: Literal["estimate", "near", "confirm"]


class _StepOf(Spec):
    """The episodes of a step, whose answers are no other episodes'; all else of them is the search's."""

    asked: str
    episodes: tuple[tuple[str, int, dict[str, str]], ...]


class _Failed(Spec):
    """Why an episode failed, and where its robot was then (x, y)."""

    reason: str
    place_m: tuple[float, float]


class _Answers(Spec):
    """What came of a step's episodes, in their order.

    Attributes:
        scores: How far each was from failing; None where that is not known.
        failures: Those that failed, by their place.
        common: How many failed with the other version, too, and are no failures, where the search is against one.
    """

    scores: tuple[float | None, ...]
    failures: dict[int, _Failed]
    common: int = 0


class _StoredAnswers(Spec):
    """A step's answers as they lie in the store, and their owner's MAC."""

    mac: str
    answers: _Answers


class SearchSteps:
    """The steps of a search, each simulated once: of its estimate, those near failures, and those that confirm them.

    Attributes:
        drawn: Its episodes.
        failed: How many episodes failed.
        common: How many failed with the version that the search is against, too, and are not among them.
        simulated: How many were simulated now.
    """

    def __init__(
        self,
        batch: OpenBatch,
        search: Search,
        drawn: DrawnEpisodes,
        run: str = "",
        drive: DriveEpisodes | None = None,
        *,
        may_simulate: bool = True,
    ) -> None:
        self.failed = self.common = self.simulated = 0
        self.drawn, self._batch, self._search, self._run = drawn, batch, search, run
        # Whoever asks for more failures has the same estimate.
        self._estimate = self._digest(search.model_copy(update={"find": SearchFind()}), "estimate")
        near = SearchFind(episodes=search.find.episodes)
        self._explore = self._digest(search.model_copy(update={"find": near}), "near")
        self._confirm = self._digest(search, "confirm")
        self._number = self._done = 0
        self._found: list[tuple[Particles, list[_Failed]]] = []
        self._drive, self._may_simulate = drive or self._driven, may_simulate
        self._folders: dict[frozenset[str], dict[str, Path]] = {}

    def _digest(self, search: Search, part: Literal["estimate", "near", "confirm"]) -> str:
        return digest(_Asked(form=_FORM, plan=self._batch.layout.plan_digest, search=search, part=part))

    def estimate(self) -> Estimated:
        """Returns how probable a failure is, by the scores of its steps."""
        going = failure_probability(
            self.drawn.space,
            budget=self._search.budget.episodes,
            confidence=self._search.estimate.confidence,
            seed=self._search.seed,
            relative_error=self._search.estimate.relativeError,
        )
        particles = next(going)
        while True:
            try:
                particles = going.send(self.scores(particles))
            except StopIteration as end:
                return end.value

    def scores(self, particles: Particles) -> Float64[np.ndarray, "particles"]:
        """Returns how far the next step's episodes were from failing."""
        self._number += 1
        return self._scores(self._estimate, self._number - 1, particles)

    def explore(self) -> None:
        """Drives episodes near failures that were met, as many as are asked for; where there is none, none.

        They stand for nothing, and count for no estimate.
        """
        left, seed = self._search.find.episodes, self._search.seed
        for number, first in enumerate(range(0, left, GENERATION)):
            particles, failures = self._met()
            if not failures:
                return
            traits, options = self.drawn.traits(particles, failures), self.drawn.options
            count = min(GENERATION, left - first)
            near = near_failures(particles, traits, options, count=count, seed=seed, generation=number)
            self._scores(self._explore, number, near)

    def _scores(self, asked: str, number: int, particles: Particles) -> Float64[np.ndarray, "particles"]:
        report_progress(STAGE, self._done, self._search.episodes)
        answers = self._answers(asked, number, self.drawn.requests(particles))
        self._done += len(answers.scores)
        report_progress(STAGE, self._done, self._search.episodes)
        self.failed += len(answers.failures)
        self.common += answers.common
        failing = sorted(answers.failures)
        self._found.append((particles.take(np.array(failing, np.intp)), [answers.failures[each] for each in failing]))
        return np.array([math.inf if each is None else each for each in answers.scores])

    def distinct(self) -> list[FoundFailure]:
        """Returns failures that are unlike each other, each simulated again, also on C MuJoCo.

        For each that vanishes the next one is taken.
        """
        wanted, driven = self._search.find.distinct, list[FoundFailure]()
        particles, failures = self._met()
        traits = self.drawn.traits(particles, failures)
        order = farthest_first(traits, _TRIES * wanted)
        while part := order[len(driven) :][: wanted - sum(each.confirmed for each in driven)]:
            requests = self.drawn.requests(particles.take(np.array(part, np.intp)))
            first = len(driven)
            again = self._answers(self._confirm, 2 * first, requests).failures
            reference = self._answers(self._confirm, 2 * first + 1, requests, REFERENCE).failures
            driven += [
                FoundFailure(
                    world=request.world,
                    seed=request.seed,
                    environment={name: request.environment[name] for name in sorted(self._search.over)},
                    reason=failures[part[place]].reason,
                    replayed=_reason(again, place),
                    reference=_reason(reference, place),
                    alike=1,
                )
                for place, request in enumerate(requests)
            ]
            report_progress(CONFIRMED, sum(each.confirmed for each in driven), wanted)
        alike = counts_of_nearest(traits, order[: len(driven)])
        return [each.model_copy(update={"alike": count}) for each, count in zip(driven, alike, strict=True)]

    def traits(self) -> FailureTraits:
        """Returns by what all failures are told apart."""
        return self.drawn.traits(*self._met())

    def _met(self) -> tuple[Particles, list[_Failed]]:
        """Returns all failures, in the order in which they were met."""
        parts = zip(*(each for each, _ in self._found), strict=True)
        return Particles(*(np.concatenate(part) for part in parts)), [each for _, part in self._found for each in part]

    def _answers(self, asked: str, number: int, requests: Sequence[EpisodeRequest], engine: str = "") -> _Answers:
        """Returns what came of a step, from the store if it is there and its owner vouches for it.

        Args:
            asked: Digest of what its answers follow from.
            number: The step's, of those with that digest.
            requests: The step's episodes.
            engine: What drives them; the batch's, if left out.
        """
        episodes = tuple((each.world, each.seed, each.environment) for each in requests)
        asked = digest(_StepOf(asked=asked, episodes=episodes))
        store, key = self._batch.store, search_step_key(self._batch.id, asked, number)
        stored, name = find_document(store, key, _StoredAnswers), f"step {number} of search {asked}"
        if stored and self._batch.authenticator.authenticates(stored.mac, name, _bytes_of(stored.answers)):
            return stored.answers
        self._require_wanted()
        if not self._may_simulate:
            raise _NotSimulatedError
        answers = self._simulated(requests, engine)
        if stored and stored.answers != answers:
            raise StageFailed("MismatchedEtag", f"{store.url}/{key} says other scores than the simulation gives")
        mac = self._batch.authenticator.mac(name, _bytes_of(answers))
        body = encode_document(_StoredAnswers(mac=mac, answers=answers))
        if stored:
            store.put(key, body)
        else:
            create_once(store, key, body)
        self.simulated += len(requests)
        return answers

    def _require_wanted(self) -> None:
        """Does nothing while the run may go on.

        Raises:
            StageFailed: Somebody has cancelled it.
        """
        if is_canceled(self._batch.store, self._run):
            raise StageFailed("Canceled", "its run was canceled on request", self._run)

    def _simulated(self, requests: Sequence[EpisodeRequest], engine: str) -> _Answers:
        plan, measure = self._batch.plan, self._search.measure
        engine = engine or plan.engine
        rows = self._drive(requests, engine)
        failures = {
            place: _Failed(reason=why, place_m=(_finite(row.final_x_m), _finite(row.final_y_m)))
            for place, row in enumerate(rows)
            if (why := why_failed(row, measure))
        }
        common = self._common([*failures], requests, engine)
        return _Answers(
            scores=tuple(_NEAREST if place in common else score_of(row, measure) for place, row in enumerate(rows)),
            failures={place: each for place, each in failures.items() if place not in common},
            common=len(common),
        )

    def _common(self, failing: list[int], requests: Sequence[EpisodeRequest], engine: str) -> frozenset[int]:
        """Returns the places of episodes, of those that failed, that fail with the other version, too."""
        other = self.drawn.other
        if other is None or not failing:
            return frozenset()
        asked = [requests[place].model_copy(update={"robot": other}) for place in failing]
        rows = self._drive(asked, engine)
        return frozenset(
            place for place, row in zip(failing, rows, strict=True) if why_failed(row, self._search.measure)
        )

    def _driven(self, requests: Sequence[EpisodeRequest], engine: str) -> list[EpisodeResult]:
        """Returns what came of episodes that run some bundles alone."""
        digests = frozenset(requests[0].bundles)
        if digests not in self._folders:
            self._folders[digests] = unpacked(self._batch.store, sorted(digests))
        return drive_episodes(self._batch, requests, engine, self._folders[digests])


def _finite(place_m: float) -> float:
    """Returns a coordinate; of a robot whose state blew up, 0."""
    return place_m if math.isfinite(place_m) else 0.0


def _bytes_of(answers: _Answers) -> bytes:
    return canonical_json(canonical_document(answers))


def _reason(failures: Mapping[int, _Failed], place: int) -> str:
    return failures[place].reason if place in failures else ""
