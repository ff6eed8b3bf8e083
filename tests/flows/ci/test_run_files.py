"""The files that a run leaves for CI: whole, never those of an older run, and no longer than GitHub takes."""

import re
from pathlib import Path

import pytest
from junitparser import JUnitXml

from flows.cli.run_command import (
    AskedRun,
    GitHubStep,
    annotations,
    append_summary,
    github_step,
    prepare_junit,
    unheard_commands,
    write_junit,
)
from specs.errors import DocumentError, SimyardError
from tests.results.ci.full_reports import full_report

ASKED = AskedRun("nightly", "file:///tmp/store")


def test_a_run_that_is_killed_leaves_a_file_that_says_so_and_not_an_older_one(tmp_path: Path):
    path = tmp_path / "new" / "junit.xml"
    prepare_junit(path, ASKED)
    assert JUnitXml.fromfile(str(path)).errors == 1
    assert "the run has not ended" in path.read_text()
    write_junit(path, full_report())
    prepare_junit(path, ASKED)
    assert "the run has not ended" in path.read_text()


def test_nothing_but_the_file_is_left(tmp_path: Path):
    write_junit(tmp_path / "junit.xml", full_report())
    assert [path.name for path in tmp_path.iterdir()] == ["junit.xml"]


def test_a_file_that_cannot_be_written_is_refused_before_the_run(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DocumentError, match=r"--junit.*a file that can be written"):
        prepare_junit(tmp_path / "file" / "junit.xml", ASKED)
    (tmp_path / "folder").mkdir()
    with pytest.raises(DocumentError, match="--junit"):
        prepare_junit(tmp_path / "folder", ASKED)


@pytest.mark.parametrize("path", [".", "/", ".."])
def test_a_folder_without_a_name_is_no_file_either(path: str):
    with pytest.raises(DocumentError, match=r"--junit.*a file that can be written"):
        prepare_junit(Path(path), ASKED)


def test_the_step_is_known_by_its_variables(tmp_path: Path):
    assert github_step({}) == GitHubStep(None, annotated=False)
    assert github_step({"GITHUB_ACTIONS": "true", "GITHUB_STEP_SUMMARY": "/s"}) == GitHubStep(
        Path("/s"), annotated=True
    )


def test_summaries_of_one_step_stand_one_below_the_other_and_keep_githubs_limit(tmp_path: Path):
    step = GitHubStep(tmp_path / "summary.md", annotated=True)
    append_summary(step, full_report())
    once = (tmp_path / "summary.md").read_text()
    append_summary(step, full_report())
    assert (tmp_path / "summary.md").read_text() == once * 2
    (tmp_path / "summary.md").write_text("x" * ((1 << 20) - 500))
    append_summary(step, full_report())
    assert (1 << 20) - 500 < (tmp_path / "summary.md").stat().st_size <= 1 << 20


def test_a_summary_that_cannot_be_written_names_the_variable(tmp_path: Path):
    with pytest.raises(SimyardError, match=r"GITHUB_STEP_SUMMARY=.*cannot be written"):
        append_summary(GitHubStep(tmp_path / "no" / "summary.md", annotated=True), full_report())


def test_annotations_name_the_document_by_its_path_in_the_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("GITHUB_WORKSPACE", str(tmp_path))
    assert "file=documents/nightly.yaml,line=1," in annotations(full_report(), tmp_path / "documents/nightly.yaml")[0]
    assert "file=" not in annotations(full_report(), Path("/elsewhere/nightly.yaml"))[0]


def test_the_runner_obeys_nothing_inside_a_run_until_it_hears_the_secret_word():
    said: list[str] = []
    with unheard_commands(GitHubStep(None, annotated=True), said.append):
        said.append("::set-output name=a::b")
    (word,) = re.findall(r"^::stop-commands::([0-9a-f]{32})$", said[0])
    assert said[1:] == ["::set-output name=a::b", f"::{word}::"]
    again: list[str] = []
    with unheard_commands(GitHubStep(None, annotated=True), again.append):
        pass
    assert again[0] != said[0]


def test_elsewhere_no_commands_are_printed():
    said: list[str] = []
    with unheard_commands(GitHubStep(None, annotated=False), said.append):
        pass
    assert said == []
