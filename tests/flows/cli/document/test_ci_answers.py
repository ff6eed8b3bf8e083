"""What `simyard run` leaves for CI, however it ends: a JUnit file, one JSON document, GitHub's summary."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from junitparser import JUnitXml

from flows.cli.run_command import AskedRun, CiWishes, run_for_ci
from flows.cli.terminal import TerminalConsole, echo, echo_json
from specs.base import Fault
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, PipelineNotPassed, SimyardError, StageFailed
from tasks.results.ci.full_report import FullReport
from tests.integration.runs import finished
from tests.repository import ROOT
from tests.results.ci.full_reports import HOSTILE, stage

PASSED = PipelineReport(run="run-1", name="nightly", stages=(stage(name="worldExport", arn=""),))
UNDECIDED = PASSED.model_copy(update={"verdict": "INCONCLUSIVE"})


def _wishes(folder: Path) -> CiWishes:
    asked = AskedRun("nightly", (folder / "store").as_uri())
    return CiWishes(folder / "nightly.yaml", asked, folder / "junit.xml", as_json=True)


def _raises(exc: BaseException) -> Callable[[], PipelineReport]:
    def run() -> PipelineReport:
        print("::set-output name=a::b")  # noqa: T201 - as a library may
        raise exc

    return run


@pytest.mark.parametrize(
    ("end", "told"),
    [
        (None, ("PASSED", 0, 0)),
        (PipelineNotPassed(UNDECIDED), ("INCONCLUSIVE", 4, 0)),
        (DocumentError([Fault(path="a", value="1", allowed="2")]), ("REFUSED", 2, 1)),
        (StageFailed("InternalServiceError", "no answer"), ("FAILED", 3, 1)),
        (SimyardError("the store is away"), ("FAILED", 3, 1)),
        (RuntimeError("a defect"), ("FAILED", 3, 1)),
    ],
)
def test_every_end_leaves_a_document_and_a_file(
    end: Exception | None, told: tuple[str, int, int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    if end is None:
        assert run_for_ci(_wishes(tmp_path), lambda: PASSED) == PASSED
    else:
        with pytest.raises(type(end)):
            run_for_ci(_wishes(tmp_path), _raises(end))
    found = FullReport.model_validate_json(capsys.readouterr().out)  # nothing else is on stdout
    assert found.document == "nightly"
    assert (found.answer, found.exit_code, JUnitXml.fromfile(str(tmp_path / "junit.xml")).errors) == told


def test_a_file_that_cannot_be_written_is_refused_with_a_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    wishes = _wishes(tmp_path)._replace(junit=tmp_path)
    with pytest.raises(DocumentError, match="--junit"):
        run_for_ci(wishes, lambda: PASSED)
    found = FullReport.model_validate_json(capsys.readouterr().out)
    assert (found.answer, found.exit_code) == ("REFUSED", 2)


@pytest.mark.parametrize(
    "end", [PipelineNotPassed(UNDECIDED), StageFailed("InternalServiceError", "no answer"), RuntimeError("a defect")]
)
def test_a_file_that_cannot_be_written_any_more_hides_no_failure(
    end: Exception, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def run() -> PipelineReport:
        (tmp_path / "junit.xml").unlink()
        (tmp_path / "junit.xml").mkdir()
        raise end

    with pytest.raises(type(end)):
        run_for_ci(_wishes(tmp_path), run)
    assert "junit.xml cannot be written" in capsys.readouterr().err


def test_an_interrupted_run_leaves_a_file_that_says_that_it_has_not_ended(tmp_path: Path):
    with pytest.raises(SystemExit):
        run_for_ci(_wishes(tmp_path), _raises(SystemExit(143)))
    assert "the run has not ended" in (tmp_path / "junit.xml").read_text()


def test_in_github_actions_there_are_a_summary_and_annotations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    with pytest.raises(StageFailed):
        run_for_ci(_wishes(tmp_path), _raises(StageFailed("InternalServiceError", "no answer")))
    told = capsys.readouterr().err.splitlines()
    word = told[0].removeprefix("::stop-commands::")
    assert told[1:3] == ["::set-output name=a::b", f"::{word}::"]
    assert told[3].startswith("::error title=nightly%3A InternalServiceError::no answer")
    assert "A stage failed" in (tmp_path / "summary.md").read_text()


def test_what_libraries_print_is_in_the_stream_in_which_the_runner_is_told_to_obey_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    with pytest.raises(StageFailed):
        run_for_ci(_wishes(tmp_path)._replace(as_json=False), _raises(StageFailed("InternalServiceError", "no answer")))
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines()[1] == "::set-output name=a::b"


def test_a_summary_that_cannot_be_written_changes_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "no" / "summary.md"))
    assert run_for_ci(_wishes(tmp_path), lambda: PASSED) == PASSED
    assert "cannot be written" in capsys.readouterr().err


def test_nothing_that_is_printed_in_github_actions_is_an_order(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    echo(HOSTILE)
    TerminalConsole().print(HOSTILE)
    echo_json(json.dumps({"why": HOSTILE}))
    told = capsys.readouterr().out
    assert "##[" not in told
    assert not [line for line in told.splitlines() if line.lstrip().startswith("::")]
    assert json.loads(told.splitlines()[-1])["why"] == HOSTILE


@pytest.mark.integration
@pytest.mark.long
def test_a_real_run_prints_one_document_and_nothing_else(tmp_path: Path):
    command = ["run", "--direct", str(ROOT / "examples/worlds-only.yaml"), "--json", "--junit", str(tmp_path / "j.xml")]
    done = finished(*command, "--store", (tmp_path / "store").as_uri(), GITHUB_ACTIONS="true")
    assert done.returncode == 0, done.stderr
    report = FullReport.model_validate_json(done.stdout)
    assert [each.status for each in report.stages] == ["Completed", "Completed"]
    assert JUnitXml.fromfile(str(tmp_path / "j.xml")).tests == 2
