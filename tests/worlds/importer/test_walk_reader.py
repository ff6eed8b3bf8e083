"""Files of positions with times: both forms say the same, and a message for each that is none."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from specs.data.world import RecordedWalk
from tasks.worlds.importer.source_scene import SourceError
from tasks.worlds.importer.walk_reader import read_walks

ROWS = """person,t_s,x_m,y_m,note
anna,0,1,2,
ben,0.5,-1,0,late
anna,2.5,1.25,2,
anna,1,1,2.5,
"""
ANNA = RecordedWalk(name="anna", times_s=(0.0, 1.0, 2.5), points_m=((1.0, 2.0), (1.0, 2.5), (1.25, 2.0)))
BEN = RecordedWalk(name="ben", times_s=(0.5,), points_m=((-1.0, 0.0),))


def written(folder: Path, text: str, name: str = "walks.csv") -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_csv_file_has_a_walk_for_each_person_in_the_order_of_time(tmp_path: Path) -> None:
    found = read_walks([written(tmp_path, ROWS)])
    assert found.walks == (ANNA, BEN)
    assert list(found.files) == ["walks/0/walks.csv"]


def test_a_parquet_file_says_the_same(tmp_path: Path) -> None:
    people, times_s = ["anna", "ben", "anna", "anna"], [0.0, 0.5, 2.5, 1.0]
    places = {"x_m": [1.0, -1.0, 1.25, 1.0], "y_m": [2.0, 0.0, 2.0, 2.5]}
    pq.write_table(pa.table({"person": people, "t_s": times_s, **places}), tmp_path / "walks.parquet")
    assert read_walks([tmp_path / "walks.parquet"]).walks == (ANNA, BEN)


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("person,t_s,x_m\n1,0,0\n", "walks.csv", "no column y_m"),
        ("person,t_s,x_m,y_m\n", "walks.csv", "no row"),
        ("person,t_s,x_m,y_m\n1,0,far,0\n", "walks.csv", "row 1"),
        ("person,t_s,x_m,y_m\n1,-1,0,0\n", "walks.csv", "a time of 0 to"),
        ("person,t_s,x_m,y_m\n1,nan,0,0\n", "walks.csv", "a time of 0 to"),
        ("person,t_s,x_m,y_m\n,1,0,0\n", "walks.csv", "a person's name"),
        ("no parquet", "walks.parquet", "no Parquet"),
    ],
)
def test_what_is_no_file_of_positions_is_refused_with_what_is_wrong(
    tmp_path: Path, text: str, name: str, message: str
) -> None:
    with pytest.raises(SourceError, match=message):
        read_walks([written(tmp_path, text, name)])


def test_a_person_of_two_files_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="a person that no other file has"):
        read_walks([written(tmp_path, ROWS), written(tmp_path, ROWS, "again.csv")])
