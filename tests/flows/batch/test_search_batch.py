"""A search over a batch: what it draws, what it keeps, that it goes on where it was, and that failures are failures."""

import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

from flows.batch import search_batch as search_module
from flows.batch import search_episodes
from flows.batch.replay_episode import bundles
from flows.batch.search_batch import (
    DrawnEpisodes,
    SearchResult,
    SearchSteps,
    _values,
    replay_found,
    search_batch,
    stored_search,
)
from flows.batch.search_episodes import DriveEpisodes, drive_episodes, shared_out
from specs.data.episode import EpisodeRequest, EpisodeResult, success
from specs.data.people import People
from specs.errors import DocumentError, ResourceNotFound, StageFailed
from specs.pipeline.search_section import Distribution, Search, SearchBudget, SearchFind
from tasks.applications.registry import publish_bundle
from tasks.progress.listener import listen_to_progress
from tasks.results.statistics.found_failures import write_search
from tasks.results.statistics.particles import Particles, Space
from tasks.simulate.batch.batch_record import OpenBatch, load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkRunner, Simulate
from tasks.simulate.engines.engine_table import REFERENCE
from tasks.simulate.replay.replay_run import resimulate
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance, submit
from tasks.storage.store_url import open_store
from tests.factories.batches import PUSHER, pushing_plan
from tests.factories.episodes import collided, crashed, passed
from tests.factories.planned_batches import request

SEARCH = Search(over={"FAULT": Distribution(uniform=(0.0, 1.0))}, budget=SearchBudget(episodes=2_000))
Row = EpisodeResult


class Killed(Exception):  # noqa: N818 - what happens to a process
    """Stands for the end of the process."""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return open_store((tmp_path / "store").as_uri())


def made(store: Store, **changes: Any) -> OpenBatch:  # noqa: ANN401 - what a plan is made of
    plan = pushing_plan(store, **changes)
    return load_batch(store, open_batch(store, plan, request(plan), "tok").id)


@pytest.fixture
def batch(store: Store) -> OpenBatch:
    return made(store)


class Simulated:
    """Episodes whose clearance follows from their variable, in place of a simulator; ends after some steps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, steps: int = 1_000_000) -> None:
        self.asked: list[list[EpisodeRequest]] = []
        self.engines: list[str] = []
        self._steps = steps
        monkeypatch.setattr(search_episodes, "resimulate", self)

    def __call__(self, _batch: OpenBatch, requests: Sequence[EpisodeRequest], run: Simulate, _lanes: int) -> list[Row]:
        if len(self.asked) == self._steps:
            raise Killed
        self.asked.append([*requests])
        runner = getattr(run, "__self__", None)
        assert isinstance(runner, ChunkRunner)
        assert all(each.bundles == runner.bundles.keys() for each in requests)  # a process has no other application's
        self.engines.append(runner.engine)
        return [self.row(each) for each in requests]

    def row(self, each: EpisodeRequest) -> Row:
        clearance_m = float(each.environment["FAULT"]) - 0.002
        if clearance_m < 0.0:
            return collided(each.index)
        return passed(each.index).model_copy(update={"min_clearance_m": clearance_m})


def found(batch: OpenBatch, search: Search = SEARCH) -> SearchResult:
    return search_batch(batch.store.url, batch.id, search)


def test_a_rare_failure_is_found_with_what_it_takes_to_drive_it_again(
    batch: OpenBatch, monkeypatch: pytest.MonkeyPatch
):
    simulated = Simulated(monkeypatch)
    search = SEARCH.model_copy(update={"budget": SearchBudget(episodes=20_000)})
    result = found(batch, search)
    answer = result.found
    assert answer.probability.method == "thinned"
    assert answer.probability.interval.lower < 0.002 < answer.probability.interval.upper
    assert result.simulated == sum(map(len, simulated.asked)) == answer.probability.episodes + 2 * 20
    assert answer.probability.episodes <= 20_000
    assert answer.failed >= len(answer.failures) == 20
    assert sum(each.alike for each in answer.failures) == answer.failed
    for each in answer.failures:
        assert float(each.environment["FAULT"]) < 0.002
        assert (each.reason, each.world in batch.plan.worlds) == ("collision", True)
        assert (each.replayed, each.reference) == ("collision", "collision")
    assert len({(each.world, each.seed, each.environment["FAULT"]) for each in answer.failures}) == 20
    assert {each.world for each in answer.failures} == {*batch.plan.worlds}
    assert simulated.engines == [batch.plan.engine] * (len(simulated.asked) - 1) + [REFERENCE]
    fault, world = answer.causes.causes
    assert (fault.name, world.name) == ("FAULT", "world")
    assert fault.share > 0.95
    assert fault.parts[0].values == "below 0.1"
    assert fault.parts[0].probability == pytest.approx(10 * 0.002, rel=0.1)
    assert fault.parts[0].interval.lower < fault.parts[0].probability < fault.parts[0].interval.upper
    assert {each.values for each in world.parts} == {*batch.plan.worlds}


class Better(Simulated):
    """A version that fails a quarter as often as its predecessor, and where that one does not: below 0.002 alone."""

    def row(self, each: EpisodeRequest) -> Row:
        fault = float(each.environment["FAULT"])
        fails = fault < 0.0005 if each.robot.version == "2" else fault < 0.002
        if fails:
            return collided(each.index)
        return passed(each.index).model_copy(update={"min_clearance_m": max(fault - 0.002, 0.0)})


def test_against_another_version_only_failures_count_where_that_one_passes(
    store: Store, batch: OpenBatch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = shutil.copytree(PUSHER, tmp_path / "pusher")
    (folder / "NEWS").write_text("another bundle")
    assert publish_bundle(store, "robot-application", "pusher", folder).number == 2
    simulated = Better(monkeypatch)
    search = SEARCH.model_copy(update={"budget": SearchBudget(episodes=20_000), "against": "2"})
    answer = found(batch, search).found
    assert 0.001 < answer.probability.estimate < 0.0019
    assert "fails where version 2 passes with probability" in answer.probability.sentence
    assert all(0.0005 <= float(each.environment["FAULT"]) < 0.002 for each in answer.failures)
    assert len(answer.failures) == 20
    assert answer.common > 0
    assert f"where version 2 passes, {answer.common:,} more with both" in answer.findings
    of_other = [each for step in simulated.asked for each in step if each.robot.version == "2"]
    assert len(of_other) == answer.failed + answer.common + 2 * 20
    assert {each.robot.digest for each in of_other}.isdisjoint(batch.plan.digests())


def test_a_version_with_another_hull_is_refused(store: Store, batch: OpenBatch, tmp_path: Path):
    folder = shutil.copytree(PUSHER, tmp_path / "pusher")
    text = (folder / "robot.xml").read_text()
    (folder / "robot.xml").write_text(text.replace('type="sphere" size="0.2"', 'type="sphere" size="0.19"'))
    assert publish_bundle(store, "robot-application", "pusher", folder).number == 2
    with pytest.raises(DocumentError, match=r"against: 2: .*the batch's hull, 0\.2 m around.*its own, 0\.19 m around"):
        DrawnEpisodes(batch, SEARCH.model_copy(update={"against": "2"}))


def test_against_itself_a_version_has_no_failure_of_its_own(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    search = SEARCH.model_copy(update={"over": {"FAULT": Distribution(uniform=(0.0, 0.01))}, "against": "1"})
    answer = found(batch, search).found
    assert (answer.failed, answer.failures) == (0, ())
    assert answer.common > 0


def test_a_version_that_is_not_there_is_told_before_anything_is_simulated(
    batch: OpenBatch, monkeypatch: pytest.MonkeyPatch
):
    simulated = Simulated(monkeypatch)
    with pytest.raises(ResourceNotFound, match="7"):
        found(batch, SEARCH.model_copy(update={"against": "7"}))
    assert simulated.asked == []


class Vanishing(Simulated):
    """Failures of which some pass on one engine: those at speeds of which a digit is even."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, engine: str) -> None:
        super().__init__(monkeypatch)
        self._engine = engine

    def row(self, each: EpisodeRequest) -> Row:
        row = super().row(each)
        gone = self.engines[-1] == self._engine and self.vanishes(each.environment["FAULT"])
        return passed(each.index) if gone and not success(row) else row

    @staticmethod
    def vanishes(value: str) -> bool:
        return int(value[-1]) % 2 == 0


@pytest.mark.parametrize("distinct", [3, 20])
def test_failures_that_vanish_on_c_mujoco_are_kept_apart_and_others_take_their_place(
    batch: OpenBatch, monkeypatch: pytest.MonkeyPatch, distinct: int
):
    Vanishing(monkeypatch, REFERENCE)
    search = SEARCH.model_copy(update={"find": SearchFind(distinct=distinct), "budget": SearchBudget(episodes=20_000)})
    answer = found(batch, search).found
    assert len(answer.failures) == distinct
    assert answer.vanished
    assert not any(Vanishing.vanishes(each.environment["FAULT"]) for each in answer.failures)
    for each in answer.vanished:
        assert (each.confirmed, each.reference, each.on_reference) == (False, "", "passed")
        assert Vanishing.vanishes(each.environment["FAULT"])
    assert f"{len(answer.vanished)} more vanished" in answer.findings


def test_more_failures_are_confirmed_without_another_estimate(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    search = SEARCH.model_copy(update={"budget": SearchBudget(episodes=20_000)})
    few = found(batch, search.model_copy(update={"find": SearchFind(distinct=5)})).found
    more = found(batch, search)
    assert more.simulated == 2 * 20
    assert more.found.probability == few.probability
    assert [each.seed for each in more.found.failures[:5]] == [each.seed for each in few.failures]


@pytest.mark.parametrize("steps", [0, 1, 7, -2, -1])
def test_a_search_that_was_killed_goes_on_to_the_same_answer(
    batch: OpenBatch, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, steps: int
):
    other = made(open_store((tmp_path / "other").as_uri()))
    simulated = Simulated(monkeypatch)
    whole = found(other)
    calls = len(simulated.asked)
    assert whole.found.failures
    first = Simulated(monkeypatch, steps if steps >= 0 else steps + calls)
    with pytest.raises(Killed):
        found(batch)
    rest = Simulated(monkeypatch)
    again = found(batch)
    assert again.found.model_copy(update={"batch": ""}) == whole.found.model_copy(update={"batch": ""})
    assert sum(map(len, first.asked)) + again.simulated == whole.simulated
    assert again.simulated == sum(map(len, rest.asked))


def test_one_that_is_asked_for_again_simulates_nothing(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    assert stored_search(batch.store, batch.id, SEARCH) is None
    whole = found(batch)
    assert found(batch) == whole._replace(simulated=0)
    assert stored_search(batch.store, batch.id, SEARCH) == whole.found
    assert found(batch, SEARCH.model_copy(update={"seed": 1})).simulated > 0


def test_worlds_seeds_and_variables_are_those_of_the_distributions(batch: OpenBatch):
    drawn = DrawnEpisodes(batch, SEARCH)
    generator = np.random.default_rng(0)
    particles = Particles(generator.standard_normal((400, 1)), generator.random((400, 2)))
    requests = drawn.requests(particles)
    assert {each.world for each in requests} == set(batch.plan.worlds)
    assert len({each.seed for each in requests}) == 400
    assert np.mean([float(each.environment["FAULT"]) for each in requests]) == pytest.approx(0.5, abs=0.05)
    assert [each.index for each in requests] == list(range(batch.layout.episodes, batch.layout.episodes + 400))
    assert {each.environment["GOALS"] for each in requests} == {"1"}


@pytest.mark.parametrize(
    ("over", "least", "median", "most"),
    [
        ({"uniform": (0.2, 0.8)}, 0.2, 0.5, 0.8),
        ({"logUniform": (0.01, 1.0)}, 0.01, 0.1, 1.0),
        ({"normal": {"mean": 1.0, "sd": 0.1}}, 0.2, 1.0, 1.8),
        ({"normal": {"mean": 1.0, "sd": 0.1, "atLeast": 0.9, "atMost": 1.1}}, 0.9, 1.0, 1.1),
        ({"normal": {"mean": 0.0, "sd": 1.0, "atLeast": 0.0}}, 0.0, 0.67449, 8.2),
    ],
)
def test_a_distribution_has_its_bounds_and_its_median(
    over: Mapping[str, object], least: float, median: float, most: float
):
    low, middle, high = map(float, _values(Distribution.model_validate(over), np.array([-8.0, 0.0, 8.0])))
    assert low == pytest.approx(least, abs=1e-6)
    assert middle == pytest.approx(median, rel=1e-4)
    assert high == pytest.approx(most, abs=0.2 if math.isclose(most, 8.2) else 1e-6)


def test_a_robots_mass_varies_where_the_batch_does_not_set_it(batch: OpenBatch):
    search = Search(over={"robot.mass": Distribution(uniform=(0.5, 1.5))}, budget=SearchBudget(episodes=1_000))
    (drawn,) = DrawnEpisodes(batch, search).requests(Particles(np.zeros((1, 1)), np.full((1, 2), 0.5)))
    assert drawn.environment == {**batch.layout.request(0).environment, "robot.mass": "1"}


def test_whole_steps_of_a_delay_are_as_likely_as_each_other(batch: OpenBatch):
    search = Search(over={"robot.controlDelay_s": Distribution(uniform=(0.05, 0.15))})
    smooth = NormalDist().inv_cdf
    particles = Particles(np.array([[smooth((row + 0.5) / 9)] for row in range(9)]), np.full((9, 2), 0.5))
    drawn = [each.environment["robot.controlDelay_s"] for each in DrawnEpisodes(batch, search).requests(particles)]
    assert drawn == ["0.05"] * 3 + ["0.1"] * 3 + ["0.15"] * 3


def test_people_vary_where_the_batch_has_some(batch: OpenBatch, store: Store):
    search = Search(over={"people.count": Distribution(uniform=(1, 3)), "people.unaware": Distribution(uniform=(0, 1))})
    with pytest.raises(DocumentError, match=r"over\.people\.count: .*a batch with people"):
        DrawnEpisodes(batch, search)
    plan = pushing_plan(store, people=People(count=4))
    some = load_batch(store, open_batch(store, plan, request(plan), "people").id)
    (drawn,) = DrawnEpisodes(some, search).requests(Particles(np.zeros((1, 2)), np.full((1, 2), 0.5)))
    assert drawn.environment == {**some.layout.request(0).environment, "people.count": "2", "people.unaware": "0.5"}


def test_starts_are_shares_of_the_floor_and_a_direction(batch: OpenBatch):
    search = Search.model_validate({"over": {"start": "anywhere"}})
    drawn = DrawnEpisodes(batch, search)
    assert [each.name for each in drawn.factors()][:3] == ["start.x_share", "start.y_share", "start.yaw_rad"]
    (asked,) = drawn.requests(Particles(np.zeros((1, 3)), np.full((1, 2), 0.5)))
    assert (asked.environment["start.x_share"], asked.environment["start.y_share"]) == ("0.5", "0.5")
    assert float(asked.environment["start.yaw_rad"]) == 0.0


def test_choices_are_as_likely_as_each_other(batch: OpenBatch):
    search = Search(over={"FAULT": Distribution(choice=("0", "7"))}, budget=SearchBudget(episodes=1_000))
    drawn = DrawnEpisodes(batch, search)
    assert drawn.space == Space(0, 3, (2, 2))
    places = (np.arange(10) + 0.5) / 10
    requests = drawn.requests(Particles(np.zeros((10, 0)), np.stack([places, places, places], axis=1)))
    assert [each.environment["FAULT"] for each in requests] == ["0"] * 5 + ["7"] * 5


def test_variables_that_the_batch_does_not_set_are_refused_all_at_once(batch: OpenBatch):
    one = Distribution(uniform=(0.0, 1.0))
    with pytest.raises(DocumentError) as refused:
        found(batch, Search(over={"SPEED": one, "MASS": one}))
    assert [each.path for each in refused.value.faults] == ["over.SPEED", "over.MASS"]
    assert "FAULT, GOALS" in refused.value.faults[0].allowed


def test_a_world_that_is_gone_is_told_before_anything_is_simulated(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    simulated = Simulated(monkeypatch)
    batch.store.delete(world_key("hand", "pen-1"))
    with pytest.raises(ResourceNotFound, match="hand/pen-1"):
        found(batch)
    assert not simulated.asked


def test_a_crash_of_the_robot_is_a_failure(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    simulated = Simulated(monkeypatch)
    monkeypatch.setattr(simulated, "row", lambda each: crashed(each.index))
    answer = found(batch).found
    assert answer.probability.estimate == 1.0
    assert answer.failures[0].reason == "RobotApplicationCrash"


def test_what_is_not_the_robots_fault_ends_the_search(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    simulated = Simulated(monkeypatch)
    broken = {"failure_code": "InternalServiceError", "failure_reason": "no memory"}
    monkeypatch.setattr(simulated, "row", lambda each: crashed(each.index).model_copy(update=broken))
    with pytest.raises(StageFailed, match="no memory"):
        found(batch)


def first_step(batch: OpenBatch) -> str:
    return min(batch.store.keys(f"searches/{batch.id}/"))


def test_scores_that_somebody_else_has_written_are_not_believed(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    found(batch)
    key = first_step(batch)
    body = batch.store.get(key).body
    batch.store.put(key, body.replace(b'"scores":[', b'"scores":[0.9999,', 1))
    with pytest.raises(StageFailed, match="says other scores than the simulation gives"):
        found(batch)


def test_a_step_that_nobody_vouches_for_is_simulated_anew(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    whole = found(batch)
    key = first_step(batch)
    before = json.loads(batch.store.get(key).body)
    batch.store.put(key, json.dumps({**before, "mac": "0" * 64}).encode())
    again = found(batch)
    assert again.found == whole.found
    assert again.simulated == len(before["answers"]["scores"])
    assert json.loads(batch.store.get(key).body) == before


def test_answers_of_a_step_are_of_no_other_episodes(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    """A library that draws other last bits makes other episodes, whatever the search's digest says."""
    simulated = Simulated(monkeypatch)
    whole = found(batch)
    monkeypatch.setattr(search_module, "_SEEDS", 2**31)
    asked = len(simulated.asked)
    assert found(batch).simulated == whole.simulated
    assert [len(each) for each in simulated.asked[asked:]] == [len(each) for each in simulated.asked[:asked]]


def test_a_run_that_is_canceled_begins_no_further_step(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    simulated = Simulated(monkeypatch)
    run = submit(batch.store, "pipeline-run", {"flow": "pipeline"}, "run")
    advance(batch.store, "pipeline-run", run.id, "Canceling")
    with pytest.raises(StageFailed, match="canceled on request"):
        search_batch(batch.store.url, batch.id, SEARCH, run.id)
    assert not simulated.asked


EXPLORED = SEARCH.model_copy(update={"budget": SearchBudget(episodes=20_000), "find": SearchFind(episodes=300)})


def test_episodes_near_failures_meet_more_of_them_and_count_for_no_estimate(
    batch: OpenBatch, monkeypatch: pytest.MonkeyPatch
):
    simulated = Simulated(monkeypatch)
    without = found(batch, EXPLORED.model_copy(update={"find": SearchFind()}))
    asked = len(simulated.asked)
    explored = found(batch, EXPLORED)
    sizes = [len(each) for each in simulated.asked[asked:]]
    assert sizes == [64, 64, 64, 64, 44, 20, 20]  # those that confirm come last
    assert explored.simulated == sum(sizes)
    assert explored.found.probability == without.found.probability
    assert explored.found.causes == without.found.causes
    assert without.found.failed + 50 < explored.found.failed == sum(each.alike for each in explored.found.failures)
    steps = SearchSteps(batch, EXPLORED, DrawnEpisodes(batch, EXPLORED))
    assert steps.estimate().probability == explored.found.probability
    steps.explore()
    assert len(steps.traits().reason) == explored.found.failed
    assert len(simulated.asked) == asked + len(sizes)


def test_a_search_that_is_killed_near_failures_goes_on_there(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    whole = found(batch, EXPLORED).found
    steps = {key: batch.store.get(key).body for key in batch.store.keys("searches/")}
    for key in [*steps][-4:]:
        batch.store.delete(key)
    assert found(batch, EXPLORED).found == whole
    assert {key: batch.store.get(key).body for key in batch.store.keys("searches/")} == steps


def test_steps_near_failures_are_those_of_as_many_and_not_of_others(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    simulated = Simulated(monkeypatch)
    found(batch, EXPLORED)
    asked = len(simulated.asked)
    found(batch, EXPLORED.model_copy(update={"find": SearchFind(episodes=100)}))
    assert [len(each) for each in simulated.asked[asked:]] == [64, 36, 20, 20]
    again = found(batch, EXPLORED.model_copy(update={"find": SearchFind(distinct=3, episodes=300)}))
    assert again.simulated == 2 * 3  # whoever asks for fewer of them has the same ones near


def test_it_is_told_how_far_it_is_to_its_last_episode(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    told: list[tuple[str, int, int]] = []
    search = SEARCH.model_copy(update={"over": {"FAULT": Distribution(uniform=(0.0, 0.01))}})
    with listen_to_progress(lambda *each: told.append(each)):
        answer = found(batch, search).found
    told = list(dict.fromkeys(told))
    assert told[0] == (search_module.STAGE, 0, 2_000)
    assert told[-2:] == [
        (search_module.STAGE, answer.probability.episodes, 2_000),
        (search_module.CONFIRMED, 20, 20),
    ]


def test_where_nothing_failed_nothing_is_near(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    search = EXPLORED.model_copy(update={"over": {"FAULT": Distribution(uniform=(0.5, 1.0))}})
    answer = found(batch, search)
    assert answer.simulated == answer.found.probability.episodes
    assert answer.found.failed == 0


def test_points_that_somebody_else_chooses_fail_where_they_fail(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    Simulated(monkeypatch)
    particles = Particles(np.array([[-3.2], [0.0], [-3.0]]), np.full((3, 2), 0.5))
    steps = SearchSteps(batch, SEARCH, DrawnEpisodes(batch, SEARCH))
    steps.scores(particles)
    assert steps.traits().numbers.ravel().tolist() == pytest.approx([0.00069, 0.00135], rel=0.01)


def test_workers_drive_all_episodes_to_the_bytes_of_one_process(store: Store, monkeypatch: pytest.MonkeyPatch):
    simulated = Simulated(monkeypatch)
    batch = made(store)
    alone = found(batch)
    steps = {key: store.get(key).body for key in store.keys("searches/")}
    for key in steps:
        store.delete(key)
    asked, driven = [*simulated.asked], list[list[EpisodeRequest]]()

    def workers(batch: OpenBatch, run: str, search: Callable[[DriveEpisodes], SearchResult]) -> SearchResult:
        assert not run

        def drive(requests: Sequence[EpisodeRequest], engine: str) -> list[Row]:
            driven.append([*requests])
            pieces = shared_out(batch, requests, 2)
            return [row for piece in pieces for row in drive_episodes(batch, piece, engine, bundles(batch))]

        return search(drive)

    spread = search_batch(store.url, batch.id, SEARCH, workers=workers)
    assert (spread, driven) == (alone, asked)
    assert {key: store.get(key).body for key in store.keys("searches/")} == steps
    again = search_batch(store.url, batch.id, SEARCH, workers=workers)
    assert (again.found, again.simulated) == (alone.found, 0)
    assert driven == asked  # of what is in the store no worker is asked


def test_only_failures_that_were_found_can_be_replayed(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(DocumentError, match="no search of its document has found a failure"):
        replay_found(batch.store, batch.id, 1)
    Simulated(monkeypatch)
    answer = found(batch, SEARCH.model_copy(update={"budget": SearchBudget(episodes=20_000)}))
    write_search(batch.store, answer.found)
    with pytest.raises(DocumentError, match="1 to 20"):
        replay_found(batch.store, batch.id, 21)


@pytest.mark.long
def test_each_failure_fails_again_when_it_is_simulated_alone(batch: OpenBatch):
    result = found(batch, Search(over={}, budget=SearchBudget(episodes=1_000)))
    answer = result.found
    assert answer.probability.episodes + 2 * 20 == result.simulated
    assert len(answer.failures) + len(answer.vanished) == 20
    runner = ChunkRunner(bundles(batch), batch.plan.engine, 1.0, lambda _: None)
    for each in answer.failures[:3]:
        alone = batch.layout.request(0).model_copy(update={"world": each.world, "seed": each.seed})
        (row,) = resimulate(batch, [alone], runner.run)
        assert success(row) is False
    write_search(batch.store, answer)
    again = replay_found(batch.store, batch.id, 2)
    assert (again.same, again.job) == (True, f"{batch.id}/found-2")
    assert again.ending == answer.failures[1].reason
    assert again.playback
