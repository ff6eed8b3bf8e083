"""A variable that no application names is told, with the one that is meant."""

from pathlib import Path

import pytest

from tasks.simulate.host.unread_variables import unread_variables


@pytest.fixture
def bundles(tmp_path: Path) -> dict[str, Path]:
    for name, text in (("rover", 'speed = float(environment["MAX_SPEED"])'), ("judge", "export LEVEL=$LEVEL")):
        (tmp_path / name / "inside").mkdir(parents=True)
        (tmp_path / name / "inside" / "main").write_text(text)
    return {name: tmp_path / name for name in ("rover", "judge")}


def test_a_variable_that_is_named_nowhere_is_told_with_the_one_that_is_meant(bundles: dict[str, Path]):
    assert [*unread_variables(bundles, ["SPEED", "LEVEL", "MAX_SPEED", "ROS_DOMAIN_ID"])] == [
        'SPEED: no file of judge or rover has this name; did you mean "MAX_SPEED"?'
    ]


def test_a_variable_that_is_like_none_is_told_alone(bundles: dict[str, Path]):
    assert [*unread_variables(bundles, ["COLOUR"])] == ["COLOUR: no file of judge or rover has this name"]


def test_a_file_that_is_too_large_to_be_read_may_name_anything(bundles: dict[str, Path]):
    (bundles["rover"] / "program").write_bytes(bytes(2 << 20))
    assert [*unread_variables(bundles, ["SPEED"])] == []


def test_a_large_mesh_names_none(bundles: dict[str, Path]):
    (bundles["rover"] / "hull.stl").write_bytes(bytes(2 << 20))
    assert [*unread_variables(bundles, ["COLOUR"])] != []
