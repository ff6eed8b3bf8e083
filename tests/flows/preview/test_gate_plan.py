"""`simyard plan` says what each rule of a gate needs, and whether the batch has it."""

from pathlib import Path

import pytest

from flows.preview.gate_plan import GateBasis, gate_basis, gate_lines
from specs.pipeline.gate_section import Gate, NoWorseThan
from tasks.storage.base.store import Store
from tests.factories.judged_batches import courier, delivery, ended
from tests.factories.planned_batches import plan, template


def lines(episodes: int = 384, audited: int = 16, **rules: object) -> list[str]:
    return list(gate_lines(Gate.model_validate(rules), GateBasis(episodes, episodes), audited))


def test_a_success_rate_is_told_with_its_power():
    assert lines(successRate={"atLeast": 0.9}) == [
        "gate              at least 90 % pass, 95 % confidence",
        "                  if 100 % pass, 35 episodes give 90 % power: 384 are ENOUGH (100 %)",
        "                  if 98 % pass, 84 episodes give 80 % power, 99 give 90 %: 384 are ENOUGH (99 %)",
        "                  if 95 % pass, 254 episodes give 80 % power, 315 give 90 %: 384 are ENOUGH (94 %)",
    ]


def test_a_batch_that_may_be_ended_early_is_told_with_what_it_drives():
    told = lines(successRate={"atLeast": 0.9}, stopEarly=True)
    assert told[3].strip() == "if 95 % pass, a batch of 384 passes with 95 % power, and drives 384 in the mean"
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9}, "stopEarly": True})
    looked = list(gate_lines(gate, GateBasis(384, 384), 16, lanes=48))[3]
    assert 200 < int(looked.split("drives ")[1].split()[0]) < 300


def test_a_batch_of_several_programs_is_told_that_it_runs_to_its_end():
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9}, "stopEarly": True})
    told = list(gate_lines(gate, GateBasis(384, 384), 16, programs=2))
    assert told[1].strip() == "if 100 % pass, 35 episodes give 90 % power: 384 are ENOUGH (100 %)"
    assert told[-1].strip() == "runs the batch to its end: its 2 programs cannot be shuffled into common chunks"
    assert list(gate_lines(gate, GateBasis(384, 384), 16))[-1].strip() == "may end the batch early, after any chunk"


def test_two_versions_that_are_compared_are_told_to_take_turns():
    gate = Gate.model_validate({"noWorseThan": {"applicationVersion": "3", "margin": 0.02}, "stopEarly": True})
    told = list(gate_lines(gate, GateBasis(384, 384), 16, programs=2, lanes=32, pairs=True))
    assert told[-1].strip() == "may end the batch early, after any chunk of both versions"


def test_too_few_are_said_to_be_so():
    assert lines(30, successRate={"atLeast": 0.9})[1].endswith("30 are NOT ENOUGH (0 %)")
    assert lines(260, successRate={"atLeast": 0.9})[3].endswith("260 are enough for 82 %")


def test_a_rate_in_worlds_like_these_is_told_in_worlds():
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9, "over": "worlds"}})
    told = [line.strip() for line in gate_lines(gate, GateBasis(384, 384), 16, worlds=8)]
    assert told[0].endswith("at least 90 % pass in worlds like these, 95 % confidence")
    assert told[1] == "if 100 % pass, 36 worlds give 90 % power: 8 are NOT ENOUGH (0 %)"
    assert "if 95 % pass at an ICC of 0.05, " in told[3]
    assert " worlds x 48 give 80 % power, " in told[3]


def test_collisions_are_told_like_successes():
    told = lines(collisionRate={"atMost": 0.1})
    assert told[0] == "gate              at most 10 % collide, 95 % confidence"
    assert told[1].strip() == "if 0 % collide, 35 episodes give 90 % power: 384 are ENOUGH (100 %)"


def test_a_comparison_needs_episodes_that_both_drive():
    told = lines(noWorseThan={"applicationVersion": "3", "margin": 0.02})
    assert told[0] == "gate              at most 2 points worse than version 3, 95 % confidence"
    assert told[1].strip() == (
        "if equal, and 0 % end otherwise, 189 driven by both give 90 % power: 384 are ENOUGH (100 %)"
    )
    assert "if equal, and 5 % end otherwise, 1,0" in told[3]
    assert told[3].endswith("384 are NOT ENOUGH (36 %)")


def test_a_comparison_that_has_nothing_to_compare_with_is_said_to_stay_open():
    gate = Gate.model_validate({"noWorseThan": {"applicationVersion": "3", "margin": 0.02}})
    told = list(gate_lines(gate, GateBasis(384, 0, "nobody drove it"), 16))
    assert [line.strip() for line in told[1:]] == ["will be INCONCLUSIVE: nobody drove it"]


def test_pairs_are_not_counted_as_episodes():
    gate = Gate.model_validate({"noWorseThan": {"applicationVersion": "3", "margin": 0.02}})
    told = list(gate_lines(gate, GateBasis(384, 40), 16))[1]
    assert "189 driven by both give 90 % power: 40 are NOT ENOUGH" in told


def test_flips_need_audited_episodes():
    told = lines(maxOutcomeFlipRate={"atMost": 0.1})
    assert told[1].strip() == "if all pass and none does, 36 audited are needed: 16 are NOT ENOUGH"


def test_quantiles_need_enough_beyond_them():
    told = lines(quantiles=[{"column": "min_clearance_m", "quantile": 0.05, "atLeast": 0.1}])
    assert told[0] == "gate              the 0.05 quantile of min_clearance_m at least 0.1, 95 % confidence"
    assert told[1].strip() == "if 0 % are beyond, 72 episodes give 90 % power: 384 are ENOUGH (100 %)"
    assert "if 2.5 % are beyond" in told[2]
    other = lines(quantiles=[{"column": "simulated_s", "quantile": 0.95, "atMost": 50}])
    assert "the 0.95 quantile of simulated_s at most 50" in other[0]


def test_several_rules_stand_one_below_the_other():
    told = lines(successRate={"atLeast": 0.9}, collisionRate={"atMost": 0.1})
    assert [line.startswith("gate") for line in told] == [True] + [False] * (len(told) - 1)


def test_a_tail_that_too_few_worlds_show_is_refused_before_the_run():
    rule = {"column": "min_clearance_m", "quantile": 0.05, "atLeast": 0.1, "over": "worlds"}
    told = list(gate_lines(Gate.model_validate({"quantiles": [rule]}), GateBasis(384, 384), 16, worlds=8))
    assert told[1].strip().startswith("will be INCONCLUSIVE: 8 worlds show too little")
    assert len(told) == 2


RULE = NoWorseThan(applicationVersion="1", margin=0.06)


class Shelf:
    """Versions of courier, and what asks a scenario of one."""

    def __init__(self, store: Store, folder: Path) -> None:
        self.old, self.new, self.third = (courier(store, folder, text) for text in ("old", "new", "third"))
        self.scenario = delivery(store, folder)

    def asks(self, robot: object, **changes: object):
        """Returns a request of a version."""
        return template(robot=robot, scenario=self.scenario, **changes)


@pytest.fixture
def shelf(file_store: Store, tmp_path: Path) -> Shelf:
    return Shelf(file_store, tmp_path)


def _judged(store: Store, shelf: Shelf, *templates: object, rule: NoWorseThan | None = RULE, **changes: object):
    return gate_basis(plan(store, templates=templates, **changes), rule, shelf.old.digest, store)


def test_of_both_versions_in_one_batch_the_tested_one_is_counted(file_store: Store, shelf: Shelf):
    both = [shelf.asks(shelf.new), shelf.asks(shelf.old)]
    assert _judged(file_store, shelf, *both) == GateBasis(episodes=6, pairs=6)
    assert _judged(file_store, shelf, *both, sweep={"SPEED": ("1", "2")}) == GateBasis(episodes=12, pairs=12)


def test_only_episodes_that_are_the_same_are_pairs(file_store: Store, shelf: Shelf):
    asked = [shelf.asks(shelf.new), shelf.asks(shelf.new, environment={"A": "1"}), shelf.asks(shelf.old)]
    assert _judged(file_store, shelf, *asked) == GateBasis(episodes=12, pairs=6)


def test_without_a_comparison_all_are_counted(file_store: Store, shelf: Shelf):
    asked = [shelf.asks(shelf.new), shelf.asks(shelf.old)]
    assert _judged(file_store, shelf, *asked, rule=None) == GateBasis(episodes=12, pairs=12)


def test_where_nobody_drove_the_other_version_it_is_said(file_store: Store, shelf: Shelf):
    assert _judged(file_store, shelf, shelf.asks(shelf.new)).no_baseline.startswith("no batch that Completed drove")
    ended(file_store, shelf.old, scenario=shelf.scenario)
    assert _judged(file_store, shelf, shelf.asks(shelf.new)) == GateBasis(episodes=6, pairs=6)
    assert _judged(file_store, shelf, shelf.asks(shelf.new), seeds=(900,)).pairs == 0


def test_two_tested_versions_leave_open_which_is_meant(file_store: Store, shelf: Shelf):
    asked = [shelf.asks(each) for each in (shelf.new, shelf.third, shelf.old)]
    assert _judged(file_store, shelf, *asked).no_baseline == "the batch tests several versions besides version 1"
