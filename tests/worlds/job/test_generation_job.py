"""A generation job makes the same worlds whoever makes them and however often it is killed; some are made again."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import pytest

from specs.errors import IdempotentParameterMismatch, StoreError
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody, template_digest
from tasks.storage.base.keys import template_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, job_id
from tasks.storage.worlds import decode_world
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.job import generation_job, production
from tasks.worlds.job.generation_job import make_and_keep, missing_worlds, run_generation_job, world_changes
from tasks.worlds.job.production import Indices, Order, WorldOutcome, make
from tests.worlds.templates import sample

BODY = sample("default-two-rooms")
ORDER = Order(template=BODY, seed=7, generation="wgj-1", robot_radius_m=0.2)
TWO: list[Indices] = [(1, 1), (1, 2)]


def always() -> bool:
    return True


class Elsewhere:
    """Workers that come to all of a job's worlds, or to the first so many."""

    def __init__(self, store: Store, most: int = 1000) -> None:
        self.asked: list[Indices] = []
        self._store, self._most = store, most

    def __call__(
        self, order: Order, indices: Sequence[Indices], *, going: Callable[[], bool], done: Callable[[int], None]
    ) -> Mapping[Indices, WorldOutcome]:
        self.asked = [*indices]
        rejected = make_and_keep(self._store, order, indices[: self._most], going)
        done(min(self._most, len(indices)))
        return {each.indices: each for each in rejected}


def test_worlds_made_by_workers_are_those_that_the_job_itself_makes(file_store: Store, s3_store: Store) -> None:
    remote, progress = Elsewhere(s3_store, most=3), Progress()
    own = run(file_store, 2, 2)
    record = run(s3_store, 2, 2, progress=progress, remote=remote)
    assert remote.asked == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert record.status == "Completed"
    assert worlds_of(s3_store, record) == worlds_of(file_store, own)
    assert progress.seen[0] == (3, 4)
    assert progress.seen[-1] == (4, 4)


def test_a_job_goes_on_where_workers_were_when_it_was_killed(file_store: Store) -> None:
    first = Elsewhere(file_store, most=1)
    with pytest.raises(KeyboardInterrupt):
        run(file_store, 1, 3, progress=Progress(dies_after=1), remote=first)
    second = Elsewhere(file_store)
    record = run(file_store, 1, 3, remote=second)
    assert (first.asked, second.asked) == ([(1, 1), (1, 2), (1, 3)], [(1, 2), (1, 3)])
    assert len(worlds_of(file_store, record)) == 3


def test_worlds_that_cannot_be_made_by_workers_are_counted_and_not_tried_again(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[object] = []
    generate_world = production.generate_world

    def failing(template: object, **which: object) -> object:
        tried.append(which["interior_index"])
        if which["interior_index"] == 2:
            raise WorldRejected("InternalServiceError", "no room for a bed")
        return generate_world(BODY, **which)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(production, "generate_world", failing)
    record = run(file_store, 1, 3, remote=Elsewhere(file_store))
    assert (record.status, record.detail["failures"]) == (
        "PartialFailed",
        {"InternalServiceError": {"count": 1, "sample_reason": "no room for a bed"}},
    )
    assert tried == [1, 2, 3]


def test_a_job_that_is_canceled_while_workers_make_its_worlds_keeps_them(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Canceled(Elsewhere):
        def __call__(
            self, order: Order, indices: Sequence[Indices], *, going: Callable[[], bool], done: Callable[[int], None]
        ) -> Mapping[Indices, WorldOutcome]:
            made = super().__call__(order, indices, going=going, done=done)
            advance(file_store, generation_job.KIND, order.generation, "Canceling")
            return made

    monkeypatch.setattr(generation_job, "_LOOK_EVERY_S", 0.0)
    record = run(file_store, 1, 3, remote=Canceled(file_store, 2))
    assert record.status == "Canceled"
    assert missing_worlds(file_store, record.id, [(1, 1), (1, 2), (1, 3)]) == [(1, 3)]


def test_nothing_more_is_made_once_nobody_wants_it(file_store: Store) -> None:
    wanted = iter([True, False])
    make_and_keep(file_store, ORDER, TWO, lambda: next(wanted))
    assert missing_worlds(file_store, "wgj-1", TWO) == [(1, 2)]


def test_a_world_is_kept_once_however_often_it_is_made(file_store: Store) -> None:
    make_and_keep(file_store, ORDER, TWO[:1], always)
    mark = file_store.mark(world_key("wgj-1", "world-1-1"))
    make_and_keep(file_store, ORDER, TWO[:1], always)
    assert file_store.mark(world_key("wgj-1", "world-1-1")) == mark


def test_a_world_of_another_version_under_its_name_is_refused(file_store: Store) -> None:
    file_store.create(world_key("wgj-1", "world-1-1"), b"{}")
    with pytest.raises(StoreError, match="something else"):
        make_and_keep(file_store, ORDER, TWO, always)


ARN = "arn:aws:robomaker:us-west-2:111111111111:world-template/my-template"


@dataclass
class Progress:
    """Remembers what was reported; dies after so many calls, like a killed process."""

    dies_after: int = 1000
    seen: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])

    def __call__(self, done: int, total: int) -> None:
        if len(self.seen) >= self.dies_after:
            raise KeyboardInterrupt
        self.seen.append((done, total))


def request(floorplans: int | None, interiors: int | None) -> CreateWorldGenerationJobRequest:
    count = {"floorplanCount": floorplans, "interiorCountPerFloorplan": interiors}
    return CreateWorldGenerationJobRequest.model_validate({"template": ARN, "worldCount": count})


def run(
    store: Store,
    floorplans: int | None = 2,
    interiors: int | None = 2,
    *,
    name: str = "t",
    seed: int = 7,
    body: TemplateBody = BODY,
    progress: Progress | None = None,
    remote: generation_job.RemoteWorldMaker | None = None,
) -> JobRecord:
    asked = request(floorplans, interiors)
    return run_generation_job(store, asked, body, seed=seed, token=name, progress=progress or Progress(), remote=remote)


def worlds_of(store: Store, record: JobRecord) -> dict[str, bytes]:
    names = [str(reference).split("/")[1] for reference in record.detail["worlds"]]  # pyright: ignore[reportGeneralTypeIssues, reportOptionalIterable, reportUnknownVariableType] # fmt: skip
    return {name: store.get(world_key(record.id, name)).body for name in names}


def test_a_job_makes_every_floor_plan_times_every_interior(file_store: Store) -> None:
    record = run(file_store, 2, 3)
    assert record.status == "Completed"
    assert list(worlds_of(file_store, record)) == [f"world-{plan}-{n}" for plan in (1, 2) for n in (1, 2, 3)]
    assert record.detail["failures"] == {}


def test_worlds_name_their_generation_and_decode(file_store: Store) -> None:
    record = run(file_store, 1, 1)
    world = decode_world(worlds_of(file_store, record)["world-1-1"])
    assert (world.generation, world.name, world.seed) == (record.id, "world-1-1", 7)


def test_progress_counts_to_the_end(file_store: Store) -> None:
    progress = Progress()
    run(file_store, 2, 2, progress=progress)
    assert progress.seen == [(n, 4) for n in range(5)]


@pytest.mark.parametrize("killed_after", [0, 1, 3, 4])
def test_a_killed_job_ends_as_an_unbroken_one(file_store: Store, killed_after: int) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(file_store, progress=Progress(dies_after=killed_after))
    resumed = run(file_store)
    whole = run(file_store, name="other")
    assert resumed.status == "Completed"
    strip = {name: body.replace(resumed.id.encode(), b"") for name, body in worlds_of(file_store, resumed).items()}
    assert strip == {name: body.replace(whole.id.encode(), b"") for name, body in worlds_of(file_store, whole).items()}


def test_a_resumed_job_leaves_finished_worlds_alone(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(file_store, progress=Progress(dies_after=3))
    made: list[tuple[int, int]] = []
    original = production.generate_world

    def counting(template: TemplateBody, **which: object) -> object:
        made.append((int(str(which["floorplan_index"])), int(str(which["interior_index"]))))
        return original(template, **which)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(production, "generate_world", counting)
    run(file_store)
    assert made == [(2, 2)]


def test_an_ended_job_is_returned_as_it_ended(file_store: Store) -> None:
    first = run(file_store)
    progress = Progress()
    assert run(file_store, progress=progress) == first
    assert progress.seen == []


def test_more_worlds_leave_those_of_the_smaller_job_as_they_are(file_store: Store) -> None:
    small, large = run(file_store, 1, 2, name="small"), run(file_store, 3, 3, name="large")
    many = worlds_of(file_store, large)
    for name, body in worlds_of(file_store, small).items():
        assert body.replace(small.id.encode(), large.id.encode()) == many[name]


@pytest.mark.parametrize(("floorplans", "interiors"), [(51, 1), (8, 7), (0, 1), (-1, -1)])
def test_a_count_out_of_range_fails_the_job_not_the_call(file_store: Store, floorplans: int, interiors: int) -> None:
    record = run(file_store, floorplans, interiors)
    assert (record.status, record.failure_code) == ("Failed", "AllWorldGenerationFailed")
    assert "1 to 50" in record.failure_reason
    assert record.detail["worlds"] == []


def test_counts_left_out_are_one(file_store: Store) -> None:
    assert len(worlds_of(file_store, run(file_store, None, None))) == 1


def test_another_seed_under_the_same_token_is_refused(file_store: Store) -> None:
    run(file_store)
    with pytest.raises(IdempotentParameterMismatch):
        run(file_store, seed=8)


def test_another_template_under_the_same_token_is_refused(file_store: Store) -> None:
    run(file_store)
    with pytest.raises(IdempotentParameterMismatch):
        run(file_store, body=sample("two-rooms"))


def test_the_template_used_is_kept_by_its_digest(file_store: Store) -> None:
    record = run(file_store, 1, 1)
    assert record.detail["template_digest"] == template_digest(BODY)
    kept = file_store.get(template_key(template_digest(BODY))).body
    assert TemplateBody.model_validate_json(kept) == BODY


def test_worlds_that_cannot_be_made_are_counted_and_the_rest_kept(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = production.generate_world

    def failing(template: TemplateBody, **which: object) -> object:
        if which["interior_index"] == 2:
            raise WorldRejected("InternalServiceError", f"no {which['floorplan_index']}")
        return original(template, **which)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(production, "generate_world", failing)
    record = run(file_store, 2, 2)
    assert (record.status, record.failure_code) == ("PartialFailed", "")
    assert list(worlds_of(file_store, record)) == ["world-1-1", "world-2-1"]
    assert record.detail["failures"] == {"InternalServiceError": {"count": 2, "sample_reason": "no 1"}}


def test_a_job_without_a_single_world_has_failed(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(template: TemplateBody, **which: object) -> object:
        raise WorldRejected("InvalidInput", "make a room larger")

    monkeypatch.setattr(production, "generate_world", failing)
    record = run(file_store, 1, 2)
    assert (record.status, record.failure_code) == ("Failed", "AllWorldGenerationFailed")
    assert record.failure_reason == "make a room larger"


def test_a_world_that_somebody_else_put_there_is_an_error(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    original = production.generate_world

    def slow(template: TemplateBody, **which: object) -> object:
        file_store.create(world_key(str(which["generation"]), "world-1-1"), b"{}")
        return original(template, **which)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(production, "generate_world", slow)
    with pytest.raises(StoreError, match="something else"):
        run(file_store, 1, 1)


def test_a_team_may_raise_the_number_of_worlds(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_WORLDS", "52")
    record = run(file_store, 52, 1)
    assert record.status == "Completed"
    assert len(worlds_of(file_store, record)) == 52


def test_a_job_that_is_canceled_keeps_the_worlds_it_made(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generation_job, "_LOOK_EVERY_S", 0.0)
    id_of_job = job_id(generation_job.KIND, "t")

    @dataclass
    class Canceling(Progress):
        def __call__(self, done: int, total: int) -> None:
            super().__call__(done, total)
            if done == 2:
                advance(file_store, generation_job.KIND, id_of_job, "Canceling")

    record = run(file_store, progress=Canceling())
    assert record.status == "Canceled"
    assert list(worlds_of(file_store, record)) == ["world-1-1", "world-1-2"]


def test_a_job_that_was_canceled_before_it_ran_makes_nothing(file_store: Store) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(file_store, progress=Progress(dies_after=0))
    advance(file_store, generation_job.KIND, job_id(generation_job.KIND, "t"), "Canceling")
    record = run(file_store)
    assert (record.status, record.detail["worlds"]) == ("Canceled", [])


def test_another_robot_under_the_same_token_is_refused(file_store: Store) -> None:
    run(file_store)
    with pytest.raises(IdempotentParameterMismatch):
        run_generation_job(
            file_store,
            request(2, 2),
            BODY,
            seed=7,
            token="t",  # noqa: S106
            progress=Progress(),
            robot_radius_m=0.3,
        )


def test_the_robot_asked_for_is_the_one_that_is_guaranteed(file_store: Store) -> None:
    record = run_generation_job(
        file_store,
        request(1, 1),
        BODY,
        seed=7,
        token="t",  # noqa: S106
        progress=Progress(),
        robot_radius_m=0.45,
    )
    certificate = decode_world(worlds_of(file_store, record)["world-1-1"]).certificate
    assert certificate.guaranteed_robot_radius_m == 0.45
    assert certificate.reachable_robot_radius_m >= 0.45


RECOUNT_ORDER = Order(template=sample("default-two-rooms"), seed=7, generation="wgj-1", robot_radius_m=0.17)
RECOUNT_REQUEST = CreateWorldGenerationJobRequest.model_validate(
    {"template": "arn:t", "worldCount": {"floorplanCount": 2, "interiorCountPerFloorplan": 1}}
)
RECOUNT_NAMES = ["wgj-1/world-1-1", "wgj-1/world-2-1"]


@pytest.fixture(scope="module")
def digests() -> dict[str, str]:
    made = [make(RECOUNT_ORDER, (plan, 1)).document.encode() for plan in (1, 2)]
    return {name: hashlib.sha256(body).hexdigest() for name, body in zip(RECOUNT_NAMES, made, strict=True)}


def test_the_worlds_of_a_template_are_found_unchanged(digests: dict[str, str]):
    assert world_changes(RECOUNT_ORDER, RECOUNT_REQUEST, RECOUNT_NAMES, digests) == []


def test_a_world_that_was_put_there_is_named(digests: dict[str, str]):
    (line,) = world_changes(RECOUNT_ORDER, RECOUNT_REQUEST, RECOUNT_NAMES, digests | {RECOUNT_NAMES[1]: "0" * 64})
    assert (
        line == f"world {RECOUNT_NAMES[1]} has the SHA-256 {'0' * 64}; the template gives {digests[RECOUNT_NAMES[1]]}"
    )


def test_a_world_that_was_left_out_is_named(digests: dict[str, str]):
    (line,) = world_changes(RECOUNT_ORDER, RECOUNT_REQUEST, RECOUNT_NAMES[:1], digests)
    assert line == f"world {RECOUNT_NAMES[1]} has the SHA-256 none; the template gives {digests[RECOUNT_NAMES[1]]}"


@pytest.mark.parametrize("worlds", [RECOUNT_NAMES[::-1], [RECOUNT_NAMES[0]] * 2, [*RECOUNT_NAMES, "wgj-2/world-1-1"]])
def test_worlds_that_nobody_asked_for_are_refused(worlds: list[str], digests: dict[str, str]):
    (line,) = world_changes(RECOUNT_ORDER, RECOUNT_REQUEST, worlds, digests)
    assert line.startswith("the record of wgj-1 names worlds that it was not asked for: [")


def test_of_many_worlds_some_are_drawn(digests: dict[str, str]):
    assert len(world_changes(RECOUNT_ORDER, RECOUNT_REQUEST, [], digests, most=1)) == 1
