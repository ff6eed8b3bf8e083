"""The tables hold every episode once, typed and described, and nothing of where and when."""

import pytest
from hypothesis import given

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.result_columns import SCHEMA_VERSION
from tasks.results.tables.episode_tables import FAILURES, RESULTS, failures_table, results_table, sweep_variables
from tests.factories.episodes import TRAJECTORY, canceled, collided, crashed, episodes, passed, request


def test_there_is_a_row_an_episode_in_the_order_of_their_indices():
    requests = [request(index, seed=10 + index) for index in range(3)]
    table = results_table("simb-1", requests[::-1], [passed(2), collided(0), crashed(1)])
    assert table.column("job").to_pylist() == ["simb-1/0", "simb-1/1", "simb-1/2"]
    assert table.column("seed").to_pylist() == [10, 11, 12]
    assert table.column("outcome_reason").to_pylist() == ["collision", "", ""]


def test_a_crash_is_no_success_even_with_all_goals_reached_and_a_cancel_is_neither():
    requests = [request(index) for index in range(4)]
    table = results_table("b", requests, [passed(0), collided(1), crashed(2), canceled(3)])
    assert table.column("success").to_pylist() == [True, False, False, None]


def test_failures_are_the_episodes_that_did_not_pass_with_reason_and_trajectory():
    requests = [request(index) for index in range(4)]
    table = failures_table("b", requests, [passed(0), collided(1), crashed(2), canceled(3)])
    assert table.column("index").to_pylist() == [1, 2]
    assert table.column("reason").to_pylist() == ["collision", "RobotApplicationCrash"]
    assert table.column("trajectory_x_m").to_pylist() == [[pose[1] for pose in TRAJECTORY], []]
    assert table.column("trajectory_yaw_rad").to_pylist()[0] == [pose[3] for pose in TRAJECTORY]


def test_a_swept_number_gets_a_column_and_a_swept_word_does_not():
    requests = [
        request(0, environment={"MAX_SPEED": "0.3", "MODE": "careful"}),
        request(1, environment={"MAX_SPEED": "0.6", "MODE": "2"}),
        request(2),
    ]
    variables = sweep_variables({"MAX_SPEED": ["0.3", "0.6", None], "MODE": ["careful", "2", None]})
    table = results_table("b", requests, [passed(index) for index in range(3)], variables)
    assert table.column("env_MAX_SPEED").to_pylist() == [0.3, 0.6, None]
    assert "env_MODE" not in table.column_names
    assert table.column("environment").to_pylist()[1] == [("MAX_SPEED", "0.6"), ("MODE", "2")]


def test_words_that_float_reads_but_that_are_no_quantity_are_no_sweep():
    assert sweep_variables({"A": ["nan"], "C": ["1e3"], "B": ["1", "inf"]}) == ["C"]


@pytest.mark.parametrize(
    "results", [[passed(0)], [passed(0), passed(0)], [passed(0), passed(2)], [passed(0), passed(1), passed(2)]]
)
def test_requests_and_results_that_do_not_pair_up_are_refused(results: list[EpisodeResult]):
    with pytest.raises(ValueError, match="pair up"):
        results_table("b", [request(0), request(1)], results)


def test_a_table_of_no_episodes_has_all_columns():
    assert results_table("b", [], []).schema.equals(RESULTS, check_metadata=True)
    assert failures_table("b", [], []).schema.equals(FAILURES, check_metadata=True)


def test_the_schema_says_its_version_and_every_column_its_meaning_and_unit():
    for schema in (RESULTS, FAILURES):
        assert (schema.metadata or {})[b"simyard.schema_version"].decode() == SCHEMA_VERSION
        for field in schema:
            metadata = field.metadata or {}
            assert metadata[b"description"].decode().endswith(".")
            assert field.name.endswith(f"_{metadata[b'unit'].decode().lower()}") or not metadata[b"unit"]


def test_every_field_of_requests_and_results_is_a_column():
    elsewhere = {"robot", "scenario", "trajectory"}  # five columns each, and four lists
    asked = set(EpisodeRequest.model_fields) - elsewhere
    answered = set(EpisodeResult.model_fields) - elsewhere
    assert asked <= set(RESULTS.names)
    assert answered - {"failure_reason"} <= set(RESULTS.names)
    assert answered <= set(FAILURES.names)


@given(episodes())
def test_the_order_of_the_input_changes_nothing(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    requests, results = drawn
    table = results_table("b", requests, results)
    assert table.equals(results_table("b", requests[::-1], results[::-1]), check_metadata=True)


@given(episodes())
def test_success_in_the_tables_splits_the_batch(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    requests, results = drawn
    table = results_table("b", requests, results)
    answers: list[bool | None] = table.column("success").to_pylist()
    assert failures_table("b", requests, results).num_rows == answers.count(False)
