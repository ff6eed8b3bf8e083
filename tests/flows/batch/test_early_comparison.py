"""A batch that drives two versions ends when their comparison is certain: they take turns on the same episodes."""

from pathlib import Path
from typing import cast

import pytest
from pydantic import JsonValue

from flows.batch.batch_steps import SequentialStop
from flows.pipeline.baselines import find_baseline
from flows.pipeline.run_gate import gate_material
from flows.pipeline.tested_batch import shuffle_if_endable
from specs.data.episode import EpisodeResult
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import GateVerdict, judge
from tasks.simulate.batch.batch_jobs import cancel_job
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import ChunkPart, Simulate, run_chunk
from tasks.storage.base.store import Store
from tests.factories.episodes import collided, passed
from tests.factories.judged_batches import courier, delivery
from tests.factories.planned_batches import all_pass, begun, plan, template
from tests.factories.simulations import PUSHER
from tests.flows.batch.test_early_end import closed

RULE = {"applicationVersion": "1", "margin": 0.1}
GATE = Gate.model_validate({"noWorseThan": RULE, "stopEarly": True})


def started(store: Store, folder: Path, name: str = "tok", gate: Gate = GATE) -> OpenBatch:
    """Returns a batch of 80 episodes of each of two versions, in chunks of 16; the tested one is named last."""
    old, new = (courier(store, folder, text) for text in ("old", "new"))
    scenario = delivery(store, folder)
    templates = tuple(template(robot=robot, scenario=scenario) for robot in (old, new))
    made = plan(store, templates=templates, seeds=tuple(range(40)), lanes=16)
    return begun(store, shuffle_if_endable(made, gate), name)


def driven(batch: OpenBatch, simulate: Simulate = all_pass, gate: Gate = GATE, most: int = 99) -> dict[str, JsonValue]:
    early = SequentialStop(batch, gate)
    for number in range(batch.layout.chunks):
        if early.ends_before(number):
            return cast("dict[str, JsonValue]", early.detail["stopped_early"])
        if number == most:
            raise KeyboardInterrupt
        run_chunk(batch, number, simulate, lanes=16, left_s=99.0)
    return {}


def judged(batch: OpenBatch, ended: dict[str, JsonValue], gate: Gate = GATE) -> GateVerdict:
    record, rule = closed(batch, ended), gate.noWorseThan
    other = find_baseline(rule, record, batch.store) if rule else None
    return judge(gate, gate_material(gate, record, batch.store, other))


def the_new_one_collides(part: ChunkPart) -> list[EpisodeResult]:
    return [(collided if each.robot.version == "2" else passed)(each.index) for each in part.chunk.requests]


def test_chunks_of_both_versions_take_turns_on_the_same_episodes(file_store: Store, tmp_path: Path):
    layout = started(file_store, tmp_path).layout
    for number in range(0, layout.chunks, 2):
        old, new = (layout.chunk(each).requests for each in (number, number + 1))
        assert [(each.world, each.seed) for each in old] == [(each.world, each.seed) for each in new]
        assert ({each.robot.version for each in old}, {each.robot.version for each in new}) == ({"1"}, {"2"})
        assert all(layout.chunk_of(each.index) == number + 1 for each in new)
    assert sorted(each.index for number in range(layout.chunks) for each in layout.chunk(number).requests) == [
        *range(160)
    ]


@pytest.mark.parametrize(("simulate", "answer"), [(all_pass, "PASS"), (the_new_one_collides, "FAIL")])
def test_a_comparison_ends_its_batch_when_it_is_certain_and_the_gate_says_the_same(
    file_store: Store, tmp_path: Path, simulate: Simulate, answer: str
):
    batch = started(file_store, tmp_path)
    ended = driven(batch, simulate)
    verdict = judged(batch, ended)
    assert (ended["verdict"], verdict.verdict) == (answer, answer)
    assert cast("int", ended["episodes"]) < 80
    assert verdict.rules[0].counted == ended["episodes"]
    assert f"{80 - cast('int', ended['episodes'])} not needed any more" in verdict.sentence


@pytest.mark.parametrize("killed_after", [1, 4])
def test_killed_anywhere_it_ends_after_the_same_pairs(file_store: Store, tmp_path: Path, killed_after: int):
    expected = driven(started(file_store, tmp_path, "unbroken"))
    with pytest.raises(KeyboardInterrupt):
        driven(started(file_store, tmp_path, "broken"), most=killed_after)
    assert driven(started(file_store, tmp_path, "broken")) == expected


def test_a_canceled_episode_of_the_other_version_does_not_help_the_tested_one(file_store: Store, tmp_path: Path):
    batch = started(file_store, tmp_path)
    whole = judged(batch, driven(batch)).rules[0]
    broken = started(file_store, tmp_path, "broken")
    cancel_job(file_store, f"{broken.id}/{broken.layout.chunk(0).requests[0].index}")
    lacking = judged(broken, driven(broken)).rules[0]
    assert (lacking.counted, lacking.facts["unknown"]) == (whole.counted - 1, 1)
    assert (lacking.lower or 0.0) <= (whole.lower or 0.0)
    assert (lacking.upper or 0.0) > (whole.upper or 0.0)


def test_what_cannot_be_paired_runs_to_its_end(file_store: Store, tmp_path: Path):
    other = Gate.model_validate({"noWorseThan": {**RULE, "applicationVersion": "7"}, "stopEarly": True})
    assert driven(started(file_store, tmp_path, gate=other), gate=other) == {}
    unequal = plan(file_store, templates=(template(), template(robot=PUSHER, duration_s=30.0)))
    assert not shuffle_if_endable(unequal, GATE).shuffled


def test_a_rate_beside_a_comparison_is_that_of_the_tested_version(file_store: Store, tmp_path: Path):
    gate = Gate.model_validate({"noWorseThan": RULE, "successRate": {"atLeast": 0.5}, "stopEarly": True})
    batch = started(file_store, tmp_path, gate=gate)
    ended = driven(batch, the_new_one_collides, gate)
    assert ended["verdict"] == "FAIL"
    assert judged(batch, ended, gate).counts.successes == 0
