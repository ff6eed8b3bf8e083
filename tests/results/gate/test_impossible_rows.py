"""A gate judges nothing by rows that cannot be, and says which they are."""

from typing import Any

import pytest

from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import judge
from tasks.results.gate.impossible_rows import IMPOSSIBLE_COLUMNS, impossible_rows
from tasks.results.gate.rules.rule import GateMaterial
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import collided, counted, crashed, passed, request

GATE = Gate.model_validate({"successRate": {"atLeast": 0.5}, "collisionRate": {"atMost": 0.5}})
# On commit 2fa7955b each of them was a PASS.
CASES: list[tuple[dict[str, Any], str]] = [
    ({"min_clearance_m": 0.0, "path_length_m": 10.0}, "a clearance of 0, no push, and a way shorter than the shortest"),
    ({"path_length_m": 5.0, "shortest_path_m": 11.0}, "passed on less than half of the shortest way"),
    ({"impulse_ns": 0.5, "max_impulse_ns": 0.5}, "a push without a collision, or one larger than all together"),
    ({"collisions": 1, "impulse_ns": 0.5, "max_impulse_ns": 0.7}, "a push without a collision, or one larger"),
    ({"path_length_m": 900.0}, "passed at more than 20 m/s in the mean"),
    ({"goals_reached": 4}, "more goals reached than there are"),
]


def material(*changed: dict[str, Any], others: int = 47) -> GateMaterial:
    odd = [passed(number).model_copy(update=changes) for number, changes in enumerate(changed)]
    results = [*odd, *(passed(number) for number in range(len(changed), len(changed) + others))]
    asked = [request(result.index) for result in results]
    return GateMaterial(counted(results), rows=results_table("simb-1", asked, results))


@pytest.mark.parametrize(("changes", "why"), CASES, ids=[why for _, why in CASES])
def test_nothing_is_judged_by_a_row_that_cannot_be(changes: dict[str, Any], why: str):
    found = judge(GATE, material(changes))
    assert found.verdict == "INCONCLUSIVE"
    assert found.sentence.startswith(f"INCONCLUSIVE: NOT JUDGED: 1 of 48 rows cannot be: {why}")
    assert "(episodes 0 in wgj-1/world-1-1)" in found.sentence
    assert [rule.verdict for rule in found.rules] == ["INCONCLUSIVE", "INCONCLUSIVE"]
    assert all(rule.estimate is None for rule in found.rules), "more episodes would not help"


def test_all_reasons_are_said_with_counts_and_the_first_places():
    found = judge(GATE, material(*[{"path_length_m": 900.0, "goals_reached": 9}] * 5))
    assert found.sentence.count("5 of 52 rows cannot be") == 2
    assert "0 in wgj-1/world-1-1, 1 in wgj-1/world-1-1, 2 in wgj-1/world-1-1 and 2 more" in found.sentence


def test_rows_that_can_be_are_judged():
    results = [passed(0), collided(1), crashed(2), *(passed(number) for number in range(3, 60))]
    rows = results_table("simb-1", [request(result.index) for result in results], results)
    assert impossible_rows(rows) == ""
    assert judge(GATE, GateMaterial(counted(results), rows=rows)).verdict == "PASS"


def test_a_simulation_that_flew_apart_and_failed_is_a_failure_and_no_doubt():
    apart = crashed(0).model_copy(update={"path_length_m": 900.0, "status": "Completed", "outcome": "Failed"})
    asked = [request(0)]
    assert impossible_rows(results_table("simb-1", asked, [apart])) == ""


def test_a_shape_that_is_no_disc_may_take_a_shorter_way():
    assert judge(GATE, material({"path_length_m": 6.0, "shortest_path_m": 11.0})).verdict == "PASS"


def test_a_ball_may_lean_over_a_low_edge_without_touching_it():
    assert judge(GATE, material({"min_clearance_m": 0.0})).verdict == "PASS"


@pytest.mark.parametrize("contacts", ["person_contacts", "robot_contacts"])
def test_people_and_other_robots_push_without_a_collision(contacts: str):
    push = {"impulse_ns": 0.5, "max_impulse_ns": 0.5}
    assert judge(GATE, material({**push, contacts: 1})).verdict == "PASS"
    assert judge(GATE, material({**push, contacts: 0})).verdict == "INCONCLUSIVE"


def test_a_push_without_a_collision_is_found_in_older_rows_that_know_no_people():
    rows = material({"impulse_ns": 0.5, "max_impulse_ns": 0.5}).rows
    assert rows is not None
    assert "1 of 48 rows cannot be: a push without" in impossible_rows(
        rows.drop_columns(["person_contacts", "robot_contacts"])
    )


def test_without_their_columns_nothing_is_said():
    rows = material({"goals_reached": 9}).rows
    assert rows is not None
    assert impossible_rows(rows.drop_columns([IMPOSSIBLE_COLUMNS[-1]])) == ""
