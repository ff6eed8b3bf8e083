"""docs/guide/gate.md says what the code does: the document in it is one, its tables and its figures are right."""

import re
from collections.abc import Mapping
from typing import get_args

import pytest
import yaml

from benchmarks.harness import markdown, with_tables
from benchmarks.results.gate import ALPHA, BAR, BATCHES, CHUNKS, EPISODES, at_looks, pairs_table, table, worlds_table
from specs.data.result_columns import COURSES, MEASURES
from specs.pipeline.gate_section import RULES, Gate
from specs.pipeline.simulation_section import Deployment, SimulationBatch
from tasks.results.gate.evidence import EVIDENCE_VERSION, Evidence
from tasks.results.gate.missing_data import ASSUMED, Assumption, Gap, Rule, codes_of
from tasks.results.statistics.intervals import quantile_ranks
from tasks.results.statistics.power import pair_needs, quantile_needs, share_needs
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/gate.md").read_text()
TEXT = " ".join(DOCUMENT.split())

BLOCKS = re.findall(r"```yaml\n(.*?)```", DOCUMENT, re.DOTALL)


def first_cells(heading: str) -> list[str]:
    rows = DOCUMENT.split(f"| {heading} |")[1].split("\n\n", maxsplit=1)[0]
    return re.findall(r"^\| `(\w+)` \|", rows, re.MULTILINE)


def test_the_document_is_one_and_has_all_rules():
    block, *_ = BLOCKS
    gate = Gate.model_validate(yaml.safe_load(block)["gate"])
    assert gate.model_fields_set == set(Gate.model_fields)
    assert gate.noWorseThan
    assert gate.noWorseThan.confidence == 0.95


def test_what_it_shows_of_builds_and_variables_is_a_document():
    *_, batch, deployment = map(yaml.safe_load, BLOCKS)
    requests = SimulationBatch.model_validate(batch["simulationBatch"]).createSimulationJobRequests
    uses = [use for request in requests for use in request.robotApplications or ()]
    assert [use.architecture for use in uses] == [None, "ARM64"]
    section = Deployment.model_validate(deployment["deployment"])
    assert {field for field in section.model_fields_set if field.startswith("untested")} == {
        "untestedBuilds",
        "untestedVariables",
    }


def test_every_rule_is_explained():
    assert first_cells("rule | about | interval") == list(RULES)


def test_every_field_of_the_evidence_is_explained():
    assert first_cells("field | says") == list(Evidence.model_fields)
    assert f"| `version` | Of this list: {EVIDENCE_VERSION}. |" in DOCUMENT


WORDS: Mapping[Rule, Mapping[Assumption, str]] = {
    "successRate": {"best": "passed", "worst": "failed"},
    "noWorseThan": {"best": "passed", "worst": "failed"},
    "other version": {"best": "failed", "worst": "passed"},
    "collisionRate": {"best": "no contact", "worst": "a contact", "seen": "what was seen"},
    "quantiles": {"best": "the best value", "worst": "the worst value", "seen": "as measured"},
    "failed: worst": {"best": "the best value", "worst": "the worst value"},
}
HEADS: Mapping[Rule, str] = {
    "noWorseThan": "`noWorseThan`, tested version",
    "other version": "`noWorseThan`, other version",
    "failed: worst": "`quantiles`, `failed: worst`",
}
CASES: Mapping[Gap, str] = {
    "robot": "Failed, the robot's own code",
    "elsewhere": "Failed, any other code",
    "canceled": "Canceled, with any code or none",
    "no result": "no row: it never ran",
    "left out": "left out by an early end",
    "no value": "Completed, the column is empty or no number",
    "not passed": "Completed, not passed",
}


def rows_of_guide() -> list[list[str]]:
    rules = list(ASSUMED)
    head = ["an episode that is", *(HEADS.get(rule, f"`{rule}`") for rule in rules)]
    return [head, *([CASES[gap], *(cell(rule, gap) for rule in rules)] for gap in get_args(Gap))]


def codes_line() -> str:
    own, others = (", ".join(f"`{code}`" for code in codes_of(gap)) for gap in ("robot", "elsewhere"))
    return f"The robot's own codes are {own}. Any other code is one of {others}."


def cell(rule: Rule, gap: Gap) -> str:
    assumed = ASSUMED[rule].get(gap)
    if assumed is None:
        return "-"
    if assumed.proof == "uncounted":
        return "not counted"
    words: Mapping[Assumption, str] = {"blocks": "no PASS", **WORDS[rule]}
    proof, blame = words[assumed.proof], words[assumed.blame]
    return proof if proof == blame else f"{proof} / {blame}"


def test_what_is_assumed_of_missing_data_is_the_table_of_the_code():
    assert with_tables(DOCUMENT, "missing", f"{markdown(rows_of_guide())}\n\n{codes_line()}") == DOCUMENT


def test_the_measures_that_an_early_end_makes_better_are_named():
    grow, fall = TEXT.split("makes better. ")[1].split(" grow while")[0], TEXT.split("to more. ")[1].split(" falls")[0]
    named = dict.fromkeys(re.findall(r"`(\w+)`", grow), "grows") | dict.fromkeys(re.findall(r"`(\w+)`", fall), "falls")
    assert named == COURSES


def test_what_it_shows_of_worlds_is_a_gate():
    shown = next(block for block in BLOCKS if "over: worlds" in block)
    gate = Gate.model_validate(yaml.safe_load(shown)["gate"])
    assert gate.successRate
    assert gate.successRate.over == "worlds"


def test_every_column_of_a_quantile_is_named():
    named = re.findall(r"`(\w+)`", TEXT.split("`column` is one of")[1].split(", or `metrics.`")[0])
    assert tuple(named) == MEASURES


def test_rules_need_as_many_episodes_as_it_says():
    needed = [share_needs(0.9, 0.95, rate, 384) for rate in (1.0, 0.98, 0.95)]
    counts = [count for needs in needed if needs for count in (needs.for_80, needs.for_90)][1:]
    power = "{} episodes if none fails; {} for 80 % power and {} for 90 % if 98 % pass; {} and {} if 95 % do"
    assert power.format(*counts) in TEXT
    pairs = pair_needs(0.02, 0.95, 0.02, 384)
    assert pairs
    assert f"need {pairs.for_90} of them for a margin of 2 points and 90 % power" in TEXT
    bounded = quantile_needs(0.05, 0.95, 0.0, 384)
    least = bounded.for_90 if bounded else 0
    assert f"The 0.05 quantile has a lower bound from {least} episodes on" in TEXT
    assert quantile_ranks(least, 0.05, 0.95)[0] == 1


@pytest.mark.long
def test_the_savings_and_errors_are_what_the_benchmark_finds():
    assert with_tables(DOCUMENT, "saving", markdown(table())) == DOCUMENT
    assert with_tables(DOCUMENT, "shuffle", markdown(worlds_table())) == DOCUMENT
    assert f"For a bar of {100 * BAR:g} % and {EPISODES} episodes" in TEXT
    assert f"{BATCHES:,} simulated batches" in TEXT


@pytest.mark.long
def test_what_comparisons_save_is_what_the_benchmark_finds():
    head, *rows = pairs_table(margins=(0.03,))
    said = [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in DOCUMENT.splitlines()]
    assert {head, *rows} <= set(said)


def test_it_errs_as_seldom_as_it_says():
    found = at_looks(BAR, CHUNKS[1])
    assert max(found.passes, found.fails) <= ALPHA / 2.0
    assert f"| {100 * BAR:g} % " in DOCUMENT
