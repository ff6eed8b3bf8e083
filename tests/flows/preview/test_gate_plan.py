"""`simyard plan` says what each rule of a gate needs, and whether the batch has it."""

from flows.preview.baseline_plan import GateBasis
from flows.preview.gate_plan import gate_lines
from specs.pipeline.gate_section import Gate


def lines(episodes: int = 384, audited: int = 16, **rules: object) -> list[str]:
    return list(gate_lines(Gate.model_validate(rules), GateBasis(episodes, episodes), audited))


def test_a_success_rate_alone_is_told_as_it_always_was():
    assert lines(successRate={"atLeast": 0.9}) == [
        "gate              at least 90 % pass, 95 % confidence",
        "                  if 100 % pass, 35 are needed: 384 are enough",
        "                  if 98 % pass, 69 are needed: 384 are enough",
        "                  if 95 % pass, 140 are needed: 384 are enough",
    ]


def test_a_batch_that_may_be_ended_early_needs_more_in_the_worst_case():
    assert lines(successRate={"atLeast": 0.9}, stopEarly=True)[1:3] == [
        "                  if 100 % pass, 44 are needed: 384 are enough",
        "                  if 98 % pass, 95 are needed: 384 are enough",
    ]


def test_a_batch_of_several_programs_is_told_that_it_runs_to_its_end():
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9}, "stopEarly": True})
    told = list(gate_lines(gate, GateBasis(384, 384), 16, programs=2))
    assert told[1].strip() == "if 100 % pass, 35 are needed: 384 are enough"
    assert told[-1].strip() == "runs the batch to its end: its 2 programs cannot be shuffled into common chunks"
    assert list(gate_lines(gate, GateBasis(384, 384), 16))[-1].strip() == "may end the batch early, after any chunk"


def test_too_few_are_said_to_be_so():
    assert "if 100 % pass, 35 are needed: 30 are NOT ENOUGH" in lines(30, successRate={"atLeast": 0.9})[1]


def test_collisions_are_told_like_successes():
    told = lines(collisionRate={"atMost": 0.1})
    assert told[0] == "gate              at most 10 % collide, 95 % confidence"
    assert told[1].strip() == "if 0 % collide, 35 are needed: 384 are enough"


def test_a_comparison_needs_episodes_that_both_drive():
    told = lines(noWorseThan={"applicationVersion": "3", "margin": 0.02})
    assert told[0] == "gate              at most 2 points worse than version 3, 95 % confidence"
    assert told[1].strip() == "if equal, and 0 % end otherwise, 189 driven by both are needed: 384 are enough"
    assert "if equal, and 10 % end otherwise, 9" in told[3]
    assert told[3].endswith("384 are NOT ENOUGH")


def test_a_comparison_that_has_nothing_to_compare_with_is_said_to_stay_open():
    gate = Gate.model_validate({"noWorseThan": {"applicationVersion": "3", "margin": 0.02}})
    told = list(gate_lines(gate, GateBasis(384, 0, "nobody drove it"), 16))
    assert [line.strip() for line in told[1:]] == ["will be INCONCLUSIVE: nobody drove it"]


def test_pairs_are_not_counted_as_episodes():
    gate = Gate.model_validate({"noWorseThan": {"applicationVersion": "3", "margin": 0.02}})
    assert "189 driven by both are needed: 40 are NOT ENOUGH" in list(gate_lines(gate, GateBasis(384, 40), 16))[1]


def test_flips_need_audited_episodes():
    told = lines(maxOutcomeFlipRate={"atMost": 0.1})
    assert told[1].strip() == "if all pass and none does, 36 audited are needed: 16 are NOT ENOUGH"


def test_quantiles_need_enough_beyond_them():
    told = lines(quantiles=[{"column": "min_clearance_m", "quantile": 0.05, "atLeast": 0.1}])
    assert told[0] == "gate              the 0.05 quantile of min_clearance_m at least 0.1, 95 % confidence"
    assert told[1].strip() == "if 0 % are beyond, 72 are needed: 384 are enough"
    assert "if 2.5 % are beyond" in told[2]
    other = lines(quantiles=[{"column": "simulated_s", "quantile": 0.95, "atMost": 50}])
    assert "the 0.95 quantile of simulated_s at most 50" in other[0]


def test_several_rules_stand_one_below_the_other():
    told = lines(successRate={"atLeast": 0.9}, collisionRate={"atMost": 0.1})
    assert [line.startswith("gate") for line in told] == [True] + [False] * (len(told) - 1)
