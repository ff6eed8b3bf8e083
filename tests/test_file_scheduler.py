"""How the tests run: a missing tool skips a test but fails it in CI, and each file stays in one process."""

import re
from pathlib import Path

import pytest

from tests.file_scheduler import group_items, unit, weight
from tests.repository import ROOT
from tests.servers.tools import need_tool

_CALL = re.compile(r'need_tool\("([\w-]+)"(?:, "([\w -]+)")?')
_SOAK_ONLY = {"postgresql", "uv"}


def test_without_a_tool_a_test_is_skipped_and_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception, match="nobody-has-this is not installed: apt-get install some-package"):
        need_tool("nobody-has-this", "some-package")


def test_in_ci_a_missing_tool_is_a_failure(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="nobody-has-this is not installed"):
        need_tool("nobody-has-this")


def test_ci_installs_what_the_tests_look_for():
    script = (ROOT / ".ci/run").read_text()
    texts = [path.read_text() for path in Path(ROOT / "tests").rglob("*.py") if path != Path(__file__)]
    packages = {match[2] or match[1] for text in texts for match in _CALL.finditer(text)} - _SOAK_ONLY
    assert packages >= {"chromium", "npm", "systemd", "ignition-tools libsdformat-dev"}
    assert [package for package in packages if f"+=({package})" not in script] == []


@pytest.mark.parametrize(
    ("test", "expected"),
    [
        ("tests/specs/test_base.py::test_one[a::b]", "tests/specs/test_base.py"),
        ("tests/docs/test_readme.py::test_one[a@b]", "tests/docs/test_readme.py"),
        ("tests/docs/test_readme.py::test_one@prefect_server", "prefect_server"),
        ("tests/integration/test_report.py::test_one[a]@team", "team"),
        ("tests/docs/test_readme.py::test_one@small_run", "small_run"),
        ("tests/flows/test_a.py::test_one[a]@long", "tests/flows/test_a.py"),
    ],
)
def test_a_file_stays_together_and_so_do_those_that_share_a_server(test: str, expected: str):
    assert unit(test) == expected


class _Item:
    """A test that asks for fixtures, and the group that it is given."""

    def __init__(self, *fixturenames: str) -> None:
        self.fixturenames = fixturenames
        self.group = ""

    def add_marker(self, mark: pytest.MarkDecorator) -> None:
        (self.group,) = mark.args

    def get_closest_marker(self, _: str) -> None:
        return None


def test_who_shares_more_than_a_server_stays_with_those_that_share_it_too():
    items = [
        _Item("tmp_path"),
        _Item("prefect_server"),
        _Item("prefect_server", "small_run"),
        _Item("owner", "attack_cache", "prefect_server"),
        _Item("team"),
    ]
    group_items(items)  # pyright: ignore[reportArgumentType] - as much of items as is asked for
    assert [each.group for each in items] == ["", "prefect_server", "small_run", "attack_cache", "team"]


def test_what_lasts_long_begins_first_so_that_no_process_waits_for_it_at_the_end():
    many, few = [f"test_{number}" for number in range(9)], ["test_one@long", "test_two"]
    tests = {
        "tests/specs/a.py": many,
        "tests/attacks/b.py": few[1:],
        "prefect_server": few[1:],
        "tests/specs/c.py": few,
    }
    order = sorted(tests, key=lambda each: weight(each, tests[each]), reverse=True)
    assert order == ["prefect_server", "tests/attacks/b.py", "tests/specs/c.py", "tests/specs/a.py"]
