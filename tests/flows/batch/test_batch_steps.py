"""A batch is ended when its gate is certain: after the same episodes wherever it was killed, with the same answer."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import cast

import pytest
from pydantic import JsonValue

from flows.batch.batch_end import batch_facts, close_with_tables
from flows.batch.batch_steps import SequentialStop
from flows.cli.ci_report import batch_counts
from flows.pipeline import recount
from flows.pipeline.baselines import find_baseline
from flows.pipeline.recount import PlannedRun, count_batch
from flows.pipeline.run_gate import gate_material
from flows.pipeline.stage_report import batch_report
from flows.pipeline.tested_batch import shuffle_if_endable
from specs.data.episode import EpisodeResult
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import GateVerdict, judge
from tasks.results.statistics.intervals import share_alone
from tasks.simulate.batch.batch_jobs import cancel_job
from tasks.simulate.batch.batch_record import OpenBatch, complete
from tasks.simulate.batch.chunk_run import ChunkPart, Simulate, run_chunk
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance
from tests.factories.episodes import collided, passed
from tests.factories.judged_batches import courier, delivery
from tests.factories.planned_batches import all_pass, begun, plan, template
from tests.factories.simulations import PUSHER

GATE = Gate.model_validate({"successRate": {"atLeast": 0.9}, "stopEarly": True})


def started(store: Store, gate: Gate = GATE, name: str = "tok") -> OpenBatch:
    """Returns a batch of 2 worlds and 80 seeds in chunks of 16."""
    return begun(store, shuffle_if_endable(plan(store, seeds=tuple(range(80)), lanes=16), gate), name)


def driven(
    batch: OpenBatch,
    simulate: Simulate = all_pass,
    gate: Gate = GATE,
    most: int = 99,
    audited: Callable[[int], dict[str, JsonValue]] | None = None,
) -> dict[str, JsonValue]:
    """Drives a batch's chunks as its flow does, until so many were simulated; returns what ended it."""
    early = SequentialStop(batch, gate, audited)
    for number in range(batch.layout.chunks):
        if early.ends_before(number):
            return cast("dict[str, JsonValue]", early.detail["stopped_early"])
        if number == most:
            raise KeyboardInterrupt
        run_chunk(batch, number, simulate, lanes=16, left_s=3600.0)
    return {}


def audit_of(flips: int) -> dict[str, JsonValue]:
    """Returns what a record says of an audit in which so many of 24 passes failed on C MuJoCo."""
    share: dict[str, JsonValue] = {"lanes": 24, "flips": flips, "chaotic": 0, "episodes": 48.0, "effective": 24.0}
    passes: JsonValue = {**share, "beyond": flips / 24, "chance": 0.01}
    return {"audit": {"verdict": "SOUND", "sentence": "", "false_passes": passes}}


def closed(batch: OpenBatch, ended: dict[str, JsonValue]) -> JobRecord:
    record = complete(batch)
    if ended:
        advance(batch.store, "simulation-job-batch", batch.id, record.status, detail={"stopped_early": ended})
    return close_with_tables(batch)


def every_other_collides(part: ChunkPart) -> list[EpisodeResult]:
    return [(collided if each.index % 2 else passed)(each.index) for each in part.chunk.requests]


def test_a_batch_that_goes_well_ends_when_that_is_certain_and_the_rest_is_canceled(file_store: Store):
    batch = started(file_store)
    ended = driven(batch)
    record = closed(batch, ended)
    assert record.status == "Completed"
    assert record.detail["counts"] == {"episodes": 64, "successes": 64, "failed_jobs": 0, "canceled": 96}
    assert ended["sentence"] == "the gate was certain of PASS after 64 episodes, so that 96 were left out"
    summary = batch_report(record, 1.0).summary
    assert summary.startswith("64 of 64 episodes passed")
    assert summary.endswith(str(ended["sentence"]))


def test_a_batch_that_may_end_early_is_shown_with_intervals_that_hold_at_each_look(file_store: Store):
    batch = started(file_store)
    record, looks = closed(batch, driven(batch)), len(batch.layout.looks())
    assert batch_facts(file_store, record, beside_tables=False).looks == looks > 0
    counts = batch_counts(file_store, record, GATE, "PASS", None)
    assert counts.interval == share_alone(64, 64, 0.95, looks)


def test_the_gate_answers_what_ended_the_batch(file_store: Store):
    for name, simulate, answer in (("good", all_pass, "PASS"), ("bad", every_other_collides, "FAIL")):
        batch = started(file_store, name=name)
        ended = driven(batch, simulate)
        verdict = judge(GATE, gate_material(GATE, closed(batch, ended), file_store, None))
        assert (ended["verdict"], verdict.verdict) == (answer, answer)
        assert f"{ended['left_out']} not needed any more" in verdict.sentence


def test_another_gate_than_the_one_that_ended_the_batch_takes_what_is_left_out_as_canceled(file_store: Store):
    batch = started(file_store)
    record = closed(batch, driven(batch))
    other = Gate.model_validate({"successRate": {"atLeast": 0.5}, "stopEarly": True})
    assert judge(other, gate_material(other, record, file_store, None)).verdict == "INCONCLUSIVE"


@pytest.mark.parametrize("killed_after", [0, 1, 2, 3])
def test_killed_anywhere_it_ends_after_the_same_episodes(file_store: Store, killed_after: int):
    unbroken, broken = started(file_store, name="unbroken"), started(file_store, name="broken")
    expected = driven(unbroken)
    try:
        driven(broken, most=killed_after)
    except KeyboardInterrupt:
        broken = started(file_store, name="broken")
    assert driven(broken) == expected
    assert closed(broken, expected).detail["counts"] == closed(unbroken, expected).detail["counts"]


def test_a_job_that_somebody_cancelled_keeps_a_good_batch_going_to_its_end(file_store: Store):
    batch = started(file_store)
    first = batch.layout.chunk(0).requests[0].index
    cancel_job(file_store, f"{batch.id}/{first}")
    assert driven(batch) == {}
    verdict = judge(GATE, gate_material(GATE, closed(batch, {}), file_store, None))
    assert verdict.sentence.endswith("; 1 canceled")
    assert verdict.verdict == "INCONCLUSIVE"


def test_a_pass_that_the_audit_so_far_doubts_ends_no_batch(file_store: Store):
    batch, asked = started(file_store), list[int]()

    def audited(chunks: int) -> dict[str, JsonValue]:
        asked.append(chunks)
        return audit_of(flips=2)

    assert driven(batch, audited=audited) == {}
    assert asked == [4]


def test_a_pass_that_stands_the_audit_ends_the_batch_with_it(file_store: Store):
    batch = started(file_store)
    early = SequentialStop(batch, GATE, lambda _: audit_of(flips=0))
    for number in range(batch.layout.chunks):
        if early.ends_before(number):
            break
        run_chunk(batch, number, all_pass, lanes=16, left_s=3600.0)
    assert early.audit == audit_of(flips=0)
    assert early.detail["stopped_early"]


def test_an_early_pass_that_nobody_vouches_for_is_audited_anew_when_it_is_counted(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    batch = started(file_store)
    record = closed(batch, driven(batch))
    unsealed = advance(file_store, record.kind, record.id, record.status, detail={"seal": "0" * 64})
    monkeypatch.setattr(recount, "bundles", lambda _: {})  # nothing is simulated: all chunks are there
    monkeypatch.setattr(recount, "audit_again", lambda *_: audit_of(flips=2))
    planned = PlannedRun(batch.plan, recorded_location(record))
    told = count_batch(unsealed, file_store, GATE, planned).changes
    assert any("says stopped_early" in line for line in told)


def test_a_batch_whose_pass_is_doubted_may_still_fail_early(file_store: Store):
    def first_pass(part: ChunkPart) -> list[EpisodeResult]:
        return all_pass(part) if part.chunk.number < 4 else [collided(each.index) for each in part.chunk.requests]

    ended = driven(started(file_store), first_pass, audited=lambda _: audit_of(flips=2))
    assert ended["verdict"] == "FAIL"


def test_without_stop_early_a_batch_is_neither_shuffled_nor_ended(file_store: Store):
    plain = Gate.model_validate({"successRate": {"atLeast": 0.9}})
    batch = started(file_store, plain)
    assert not batch.plan.shuffled
    assert driven(batch, gate=plain) == {}
    assert shuffle_if_endable(batch.plan, None) == batch.plan


def test_a_batch_of_several_programs_runs_to_its_end_and_is_judged_as_one_that_does(file_store: Store):
    two = plan(file_store, templates=(template(), template(robot=PUSHER)), seeds=tuple(range(40)), lanes=16)
    assert shuffle_if_endable(two, GATE) == two
    batch = begun(file_store, shuffle_if_endable(two, GATE))
    assert driven(batch) == {}
    found = gate_material(GATE, closed(batch, {}), file_store, None)
    assert not found.lacks.sequential


def test_the_record_says_after_how_many_episodes_the_gate_was_asked(file_store: Store):
    assert driven(started(file_store))["looks"] == [*range(16, 161, 16)]


RULE = {"applicationVersion": "1", "margin": 0.1}
COMPARING_GATE = Gate.model_validate({"noWorseThan": RULE, "stopEarly": True})


def started_pairs(store: Store, folder: Path, name: str = "tok", gate: Gate = COMPARING_GATE) -> OpenBatch:
    """Returns a batch of 80 episodes of each of two versions, in chunks of 16; the tested one is named last."""
    old, new = (courier(store, folder, text) for text in ("old", "new"))
    scenario = delivery(store, folder)
    templates = tuple(template(robot=robot, scenario=scenario) for robot in (old, new))
    made = plan(store, templates=templates, seeds=tuple(range(40)), lanes=16)
    return begun(store, shuffle_if_endable(made, gate), name)


driven_pairs = partial(driven, gate=COMPARING_GATE)


def judged(batch: OpenBatch, ended: dict[str, JsonValue], gate: Gate = COMPARING_GATE) -> GateVerdict:
    record, rule = closed(batch, ended), gate.noWorseThan
    other = find_baseline(rule, record, batch.store) if rule else None
    return judge(gate, gate_material(gate, record, batch.store, other))


def the_new_one_collides(part: ChunkPart) -> list[EpisodeResult]:
    return [(collided if each.robot.version == "2" else passed)(each.index) for each in part.chunk.requests]


def test_chunks_of_both_versions_take_turns_on_the_same_episodes(file_store: Store, tmp_path: Path):
    layout = started_pairs(file_store, tmp_path).layout
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
    batch = started_pairs(file_store, tmp_path)
    ended = driven_pairs(batch, simulate)
    verdict = judged(batch, ended)
    assert (ended["verdict"], verdict.verdict) == (answer, answer)
    assert cast("int", ended["episodes"]) < 80
    assert verdict.rules[0].counted == ended["episodes"]
    assert f"{80 - cast('int', ended['episodes'])} not needed any more" in verdict.sentence


@pytest.mark.parametrize("killed_after", [1, 4])
def test_killed_anywhere_it_ends_after_the_same_pairs(file_store: Store, tmp_path: Path, killed_after: int):
    expected = driven_pairs(started_pairs(file_store, tmp_path, "unbroken"))
    with pytest.raises(KeyboardInterrupt):
        driven_pairs(started_pairs(file_store, tmp_path, "broken"), most=killed_after)
    assert driven_pairs(started_pairs(file_store, tmp_path, "broken")) == expected


def test_a_canceled_episode_of_the_other_version_does_not_help_the_tested_one(file_store: Store, tmp_path: Path):
    batch = started_pairs(file_store, tmp_path)
    whole = judged(batch, driven_pairs(batch)).rules[0]
    broken = started_pairs(file_store, tmp_path, "broken")
    cancel_job(file_store, f"{broken.id}/{broken.layout.chunk(0).requests[0].index}")
    lacking = judged(broken, driven_pairs(broken)).rules[0]
    assert (lacking.counted, lacking.facts["unknown"]) == (whole.counted - 1, 1)
    assert (lacking.lower or 0.0) <= (whole.lower or 0.0)
    assert (lacking.upper or 0.0) > (whole.upper or 0.0)


def test_what_cannot_be_paired_runs_to_its_end(file_store: Store, tmp_path: Path):
    other = Gate.model_validate({"noWorseThan": {**RULE, "applicationVersion": "7"}, "stopEarly": True})
    assert driven_pairs(started_pairs(file_store, tmp_path, gate=other), gate=other) == {}
    unequal = plan(file_store, templates=(template(), template(robot=PUSHER, duration_s=30.0)))
    assert not shuffle_if_endable(unequal, COMPARING_GATE).shuffled


def test_a_rate_beside_a_comparison_is_that_of_the_tested_version(file_store: Store, tmp_path: Path):
    gate = Gate.model_validate({"noWorseThan": RULE, "successRate": {"atLeast": 0.5}, "stopEarly": True})
    batch = started_pairs(file_store, tmp_path, gate=gate)
    ended = driven_pairs(batch, the_new_one_collides, gate=gate)
    assert ended["verdict"] == "FAIL"
    assert judged(batch, ended, gate).counts.successes == 0
