"""docs/guide/queries.md: every query runs on tables as a batch writes them, and answers what it says."""

import re
from pathlib import Path
from typing import cast

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.result_columns import SCHEMA_VERSION
from tasks.results.statistics.intervals import wilson
from tasks.results.tables.episode_tables import failures_table, results_table
from tasks.results.tables.parquet import write_parquet
from tasks.storage.store_url import connect
from tests.factories.episodes import canceled, collided, crashed, passed, request
from tests.repository import ROOT
from tests.servers.seaweed import Seaweed

DOCUMENT = (ROOT / "docs/guide/queries.md").read_text()
SECTIONS = dict(
    zip(
        re.findall(r"^## (.*)$", DOCUMENT, re.MULTILINE),
        re.split(r"^## .*$\n", DOCUMENT, flags=re.MULTILINE)[1:],
        strict=True,
    )
)
QUESTIONS = [heading for heading in SECTIONS if heading[0].isdigit()]
Rows = list[tuple[object, ...]]


def blocks(heading: str) -> list[tuple[str, str]]:
    """Returns the language and the text of each block of a section."""
    return re.findall(r"```(sql|python)\n(.*?)```", SECTIONS[heading], re.DOTALL)


def episodes(kinds: str) -> tuple[list[EpisodeRequest], list[EpisodeResult]]:
    """Returns an episode a letter (passed, hit, crashed, stopped), worlds and speeds in turn."""
    makers = {"p": passed, "h": collided, "c": crashed, "s": canceled}
    results = [makers[kind](index) for index, kind in enumerate(kinds)]
    changed = [
        result.model_copy(update={"goal_times_s": (10.0, 25.0 + result.index)[: result.goals_reached]})
        for result in results
    ]
    pushed = [each.model_copy(update={"max_impulse_ns": float(each.collisions * each.index)}) for each in changed]
    requests = [
        request(
            index, world=f"g/w{index % 2}", seed=index // 2, environment={"MAX_SPEED": ("0.3", "0.6")[index // 4 % 2]}
        )
        for index in range(len(kinds))
    ]
    return requests, pushed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of a batch, beside that of the batch before."""
    for batch, kinds in (("simb-1", "phpphpcs"), ("simb-before", "pppppppp")):
        (tmp_path / batch).mkdir()
        requests, results = episodes(kinds)
        for table, name in ((results_table, "results"), (failures_table, "failures")):
            write_parquet(table(batch, requests, results, ["MAX_SPEED"]), tmp_path / batch / f"{name}.parquet")
    return tmp_path / "simb-1"


@pytest.fixture(scope="module")
def bucket(seaweed: Seaweed) -> None:
    """The bucket that the document reads from, on the server of this test run."""
    seaweed.make_bucket("my-results")


def answered(heading: str, number: int = 0) -> object:
    """Returns the answer of a block, run where this process is."""
    language, text = blocks(heading)[number]
    if language == "sql":
        import duckdb  # noqa: PLC0415 - what only these blocks need

        with duckdb.connect() as connection:
            return connection.execute(text).fetchall()
    names: dict[str, object] = {}
    exec(compile(text, heading, "exec"), names)  # noqa: S102 - our own document
    return names["answer"]


def rows(answer: object) -> Rows:
    """Returns the rows of what DuckDB, Polars or pandas answered."""
    import pandas as pd  # noqa: PLC0415 - what only these blocks need
    import polars as pl  # noqa: PLC0415 - same

    if isinstance(answer, pl.DataFrame):
        return answer.rows()
    if isinstance(answer, pd.DataFrame):
        return [tuple(row) for row in answer.itertuples(name=None)]
    if isinstance(answer, pd.Series):
        return [*answer.items()]
    return cast("Rows", answer)


ANSWERS: dict[str, Rows] = {
    "1": [("g/w0", 4, 0.5, 0.15, 0.85), ("g/w1", 3, 0.667, 0.208, 0.939)],
    "2": [("g/w0", 1, 1, 2), ("g/w1", 0, 1, 1), ("All", 1, 2, 3)],
    "3": [(0.3, 4, 0.75, 31.5, 0.11), (0.6, 3, 0.333, 31.5, 0.11)],
    "4": [
        ("simb-1/1", "g/w1", 0, "0.3", "1", "1", "collision"),
        ("simb-1/4", "g/w0", 2, "0.6", "1", "1", "collision"),
        ("simb-1/6", "g/w0", 3, "0.6", "1", "1", "RobotApplicationCrash"),
    ],
    "5": [("simb-1", "courier", "1", 7, 0.571), ("simb-before", "courier", "1", 8, 1.0)],
    "6": [("g/w0", 4.0, -1.0, 1), ("g/w1", 4.0, -1.0, 1)],
    "7": [("g/w0", 0.11, 0.11, 0.11), ("g/w1", 0.11, 0.11, 0.11)],
    "8": [(0.3, 1.114, 0.898, 3.43), (0.6, 1.114, 0.898, 3.43)],
    "9": [(1, 8, 10.0, 10.0), (2, 6, 19.0, 21.8)],
    "10": [
        ("collision", "g/w0", 2, 8.0, 31.5, "simyard replay simb-1/4"),
        ("collision", "g/w1", 0, 2.0, 31.5, "simyard replay simb-1/1"),
        ("RobotApplicationCrash", "g/w0", 3, 0.0, 31.5, "simyard replay simb-1/6"),
    ],
}


def test_there_are_ten_questions_and_one_query_for_each():
    assert [heading.partition(".")[0] for heading in QUESTIONS] == list(ANSWERS)
    assert {len(blocks(heading)) for heading in QUESTIONS} == {1}


@pytest.mark.parametrize("heading", QUESTIONS)
def test_each_question_is_answered(heading: str, folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(folder)
    assert rows(answered(heading)) == ANSWERS[heading.partition(".")[0]]


def test_the_interval_in_sql_is_the_one_that_the_gate_uses(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(folder)
    for (successes, n), row in zip(((2, 4), (2, 3)), rows(answered(QUESTIONS[0])), strict=True):
        exact = wilson(successes, n, 0.95)
        assert row[3:] == pytest.approx((exact.lower, exact.upper), abs=1e-3)


def test_the_footer_says_what_made_the_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(folder)
    assert answered("What made this file?") == {"simyard.schema_version": SCHEMA_VERSION, "simyard.table": "results"}
    assert "Success weighted by path length" in capsys.readouterr().out


@pytest.mark.parametrize("number", range(3), ids=["polars", "pandas", "duckdb"])
@pytest.mark.usefixtures("s3_url", "bucket")
def test_the_same_is_read_from_s3(number: int, folder: Path):
    connect("s3://my-results").upload("nightly/simb-1/results.parquet", folder / "results.parquet")
    found = rows(answered("From S3", number))
    assert [(world, round(cast("float", rate), 3)) for world, rate in found] == [("g/w0", 0.5), ("g/w1", 0.667)]


def test_no_block_is_left_untested():
    assert len(re.findall(r"^```\w+$", DOCUMENT, re.MULTILINE)) == len(QUESTIONS) + 3 + 1
