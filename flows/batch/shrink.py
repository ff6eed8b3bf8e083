"""`simyard shrink`: the smallest world and the lowest seed in which a job still fails in the same way.

It is written as a regression case: the world, a pipeline document that simulates it, drawings of before and after.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile
from math import dist
from pathlib import Path
from typing import NamedTuple

import yaml
from pydantic import JsonValue

from flows.batch.replay_episode import bundles
from specs.base import Fault, canonical_document
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult, reason, success
from specs.data.physics import PHYSICAL, application_variables
from specs.data.world import World
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from specs.template.body import TemplateBody
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.progress.listener import report_progress
from tasks.results.playback.plan_drawings import failure_map_svg
from tasks.simulate.batch.batch_record import OpenBatch, job_of
from tasks.simulate.batch.chunk_run import load_worlds
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.data.data_sources import DATA_PREFIX
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.plan_batch import entries
from tasks.simulate.replay.smallest_case import (
    Case,
    Ending,
    Names,
    Trial,
    is_of_same_kind,
    is_same_failure,
    is_same_goal,
    simulate_trials,
    smallest_case,
)
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_resource
from tasks.storage.worlds import encode_world, write_world
from tasks.worlds.certificate import SHRUNK, broken_guarantees
from tasks.worlds.importer.own_floor import keep_pieces

_DIGEST_SHOWN = 8


_Alike = Callable[[Ending, Ending], bool]


class ShrunkJob(NamedTuple):
    """A job that fails, and a smaller one that fails in the same way.

    Attributes:
        batch: The job's batch.
        job: ``<batch>/<index>``.
        reason: How both fail, in a word or two.
        same: Whether it is the same failure, as ``is_same_failure`` says; else it is another one of that kind.
        request, world, ending: The job, where it took place, and what came of it.
        small_request, small_world, small_ending: The same of the smaller one, whose world is in the store.
        episodes: How many were simulated.
        minimal: Whether the failure is gone without any single piece of furniture that is left.
        broken: What the smaller world does not guarantee, one sentence each.
    """

    batch: OpenBatch
    job: str
    reason: str
    same: bool
    request: EpisodeRequest
    world: World
    ending: Ending
    small_request: EpisodeRequest
    small_world: World
    small_ending: Ending
    episodes: int
    minimal: bool
    broken: tuple[str, ...]

    @property
    def row(self) -> EpisodeResult:
        """Returns what came of the job."""
        return self.ending.row

    @property
    def small_row(self) -> EpisodeResult:
        """Returns what came of the smaller job."""
        return self.small_ending.row

    @property
    def likeness(self) -> str:
        """Returns how alike the two failures are, as a part of a sentence."""
        distance = f"{dist(self.ending.place_m, self.small_ending.place_m):.2f} m from the job's"
        if self.same:
            return f"the same, {distance}, on the way to the same goal"
        goal = "the same" if is_same_goal(self.ending, self.small_ending) else "another"
        return f"another failure of that kind, {distance}, on the way to {goal} goal"


def shrink_job(store: Store, text: str, budget: int) -> ShrunkJob:
    """Returns the smaller job of a simulation job, by its ARN or ``<batch>/<index>``; its world is put into the store.

    It is the same failure wherever a smaller job has that; only where none was found it is another one of that kind.

    Args:
        store: Where the job's batch is.
        text: Names the job.
        budget: How many episodes may be simulated; at least 2.

    Raises:
        ResourceNotFound: There is no such job, or what it needs is gone.
        DocumentError: The job did not fail, or does not fail again.
    """
    batch, index = job_of(store, find_resource(store, text, ("simulation-job",)).path)
    if batch.plan.robots:
        raise _refused(
            batch, index, f"one of a robot that is alone in its world; this one is one of {batch.plan.robots}"
        )
    search = _Search(batch, index, _failed_row(batch, index), budget)
    found, minimal = search.smallest(is_same_failure)
    if found == search.case:
        found, minimal = search.smallest(is_of_same_kind)
    world = _store_world(store, search.furnished(found.names), batch, index)
    (ending,) = search.simulated([Trial(world, found.seed)])
    return ShrunkJob(
        batch=batch,
        job=f"{batch.id}/{index}",
        reason=reason(search.first.row),
        same=is_same_failure(search.first, ending),
        request=search.request,
        world=search.world,
        ending=search.first,
        small_request=search.request.model_copy(
            update={"world": f"{world.generation}/{world.name}", "seed": found.seed}
        ),
        small_world=world,
        small_ending=ending,
        episodes=search.episodes,
        minimal=minimal,
        broken=() if world.source else broken_guarantees(world.certificate),
    )


class _Search:
    """Episodes like one that failed, each simulated once, and no more than a budget allows.

    Attributes:
        first: How the job ends, simulated again.
        case: All its furniture, and its seed.
        episodes: How many were simulated.
    """

    def __init__(self, batch: OpenBatch, index: int, row: EpisodeResult, budget: int) -> None:
        self.batch, self.engine, self.episodes = batch, row.engine, 0
        self._most = budget - 1  # the last one shows what was found
        self.request = batch.layout.request(index)
        worlds, missing = load_worlds(batch, [self.request])
        if missing:
            allowed = f"one whose world is there: {missing[self.request.world]}"
            raise ResourceNotFound([_fault(batch, index, allowed)], "simyard")
        self.world = worlds[self.request.world]
        self.case = Case(tuple(piece.name for piece in self.world.furniture), self.request.seed)
        self._template, self._bundles = _template(batch.store, self.world), bundles(batch)
        (self.first,) = self.simulated([Trial(self.world, self.request.seed)])
        if not is_same_failure(self.first, Ending(row, self.first.goal_m)):
            again = reason(self.first.row) or "passed"
            raise _refused(
                batch, index, f"one that fails so again: now it is {again}; simyard replay says what deviates"
            )
        self._endings = {self.case: self.first}

    def smallest(self, alike: _Alike) -> tuple[Case, bool]:
        """Returns the smallest case that fails like the job, and whether each of its pieces is known to be needed."""

        def still_fails(cases: Sequence[Case]) -> list[bool]:
            return [alike(self.first, ending) for ending in self._ends(cases)]

        return smallest_case(self.case, still_fails)

    def furnished(self, names: Names) -> World:
        return keep_pieces(self.world, names, self._template)

    def simulated(self, trials: Sequence[Trial]) -> list[Ending]:
        report_progress("Episodes", self.episodes, self._most + 1)
        self.episodes += len(trials)
        return simulate_trials(self.batch, self.request, trials, self._bundles, engine=self.engine)

    def _ends(self, cases: Sequence[Case]) -> list[Ending]:
        """Returns how cases end, from the first one on, until the budget ends."""
        new = [case for case in dict.fromkeys(cases) if case not in self._endings][: self._most - self.episodes]
        worlds = {names: self.furnished(names) for names in dict.fromkeys(case.names for case in new)}
        endings = self.simulated([Trial(worlds[case.names], case.seed) for case in new]) if new else []
        self._endings |= dict(zip(new, endings, strict=True))
        return [self._endings[case] for case in takewhile(self._endings.__contains__, cases)]


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


_BUCKET, _PREFIX = "results", "regressions"
_Document = dict[str, JsonValue]


def write_case(found: ShrunkJob, folder: Path) -> list[Path]:
    """Returns the files of a regression case, written: ``case.yaml``, ``world.json``, ``before.svg``, ``after.svg``."""
    folder.mkdir(parents=True, exist_ok=True)
    job, small = found.job, f"{found.small_world.name} seed {found.small_request.seed}"
    bodies = {
        "case.yaml": case_document(found).encode(),
        "world.json": encode_world(found.small_world),
        "before.svg": failure_map_svg(floor_plan_svg(found.world), [(job, found.row)]).encode(),
        "after.svg": failure_map_svg(floor_plan_svg(found.small_world), [(small, found.small_row)]).encode(),
    }
    for name, body in bodies.items():
        (folder / name).write_bytes(body)
    return [folder / name for name in bodies]


def case_document(found: ShrunkJob) -> str:
    """Returns a pipeline document whose batch is the shrunk job alone, as YAML with what it is about on top.

    It names no version, so that it tries the newest one.
    """
    launch, request = found.request.robot, found.small_request
    before, after = len(found.world.furniture), len(found.small_world.furniture)
    about = [
        f"{found.job} fails: {found.reason}. Shrunk from {before} pieces of furniture to {after}, and from seed "
        f"{found.request.seed} to {request.seed}.",
        f"The failure here: {found.likeness}.",
        f"It failed with {launch.name} version {launch.version} ({launch.digest[:12]}); this tries the newest one.",
        "The world must be in the store: simyard world add world.json puts it there.",
    ]
    document: _Document = {
        "name": f"shrunk-{found.small_world.name}"[:64],
        "simulationBatch": {
            "engine": found.batch.plan.engine,
            **moved_documents(found.batch.plan),
            "outputLocation": {"s3Bucket": _BUCKET, "s3Prefix": _PREFIX},
            "recordings": {"episodes": "all"},
            "audit": {"lanes": 0},  # of a single episode it says next to nothing
            "matrix": {"worlds": [request.world], "seeds": [request.seed]},
            "createSimulationJobRequests": [case_request(found.batch, found.small_request)],
        },
    }
    return "".join(f"# {line}\n" for line in about) + yaml.safe_dump(document, sort_keys=False, width=100)


def moved_documents(plan: BatchPlan) -> _Document:
    """Returns the fields of a section that say who walks, and what is put, into the worlds of a batch."""
    people: _Document = {"people": canonical_document(plan.people)} if plan.people else {}
    boxes: _Document = {"boxes": [canonical_document(box) for box in plan.boxes]} if plan.boxes else {}
    return {**people, **boxes}


def case_request(batch: OpenBatch, request: EpisodeRequest, entry: int | None = None) -> dict[str, JsonValue]:
    """Returns the request of a document that drives an episode like one of a batch; its world and seed are not in it.

    It names no version, so that it tries the newest one.

    Args:
        batch: The batch.
        request: The episode.
        entry: The position of the batch's request that it came from; that of its index, if left out.
    """
    asked = entries(batch.record())[batch.layout.template_of(request.index) if entry is None else entry]
    data: _Document = {"dataSources": asked["dataSources"]} if asked.get("dataSources") else {}
    physics: _Document = {name: float(value) for name, value in request.environment.items() if name in PHYSICAL}
    robots: _Document = {} if request.alone else {"robotApplications": [_use(request.robot, request.environment)]}
    judging = request.environment if request.alone else request.judge_environment or {}
    return {
        "maxJobDurationInSeconds": int(request.duration_s),
        "failureBehavior": request.failure_behavior,
        **({"physics": physics} if physics else {}),
        **data,
        **robots,
        "simulationApplications": [_use(request.scenario, judging)],
    }


def _use(launch: ApplicationLaunch, environment: Mapping[str, str]) -> _Document:
    own = application_variables(environment)
    variables = {name: value for name, value in own.items() if not value.startswith(DATA_PREFIX)}
    config: _Document = {"packageName": launch.package, "launchFile": launch.launch_file}
    if launch.command is not None:
        config = {"command": list(launch.command)}
    if variables:
        config["environmentVariables"] = {**variables}
    other: _Document = {"architecture": launch.architecture} if launch.architecture not in {None, "X86_64"} else {}
    return {"application": launch.name, **other, "launchConfig": config}
