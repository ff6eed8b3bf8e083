"""How far a run is can be read while it goes on, in a terminal and in the log of a CI."""

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from junitparser import JUnitXml
from rich.console import Console

from flows.cli.run_command import (
    AskedRun,
    CiWishes,
    GitHubStep,
    ProgressLines,
    annotations,
    append_summary,
    github_step,
    prepare_junit,
    progress_bars,
    tell_ci,
    unheard_commands,
    write_junit,
)
from flows.cli.terminal import TerminalConsole, echo, echo_json
from specs.base import Fault
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, PipelineNotPassed, SimyardError, StageFailed
from tasks.results.ci.full_report import FullReport
from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store
from tests.integration.runs import JOB_KINDS, finished, simyard, small_document, write_document
from tests.repository import ROOT
from tests.results.ci.full_reports import HOSTILE, full_report, stage
from tests.servers.eventually import eventually


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def lines(*told: tuple[float, str, int, int]) -> list[str]:
    console, clock = Console(file=io.StringIO(), record=True), Clock()
    shown = ProgressLines(console, clock)
    for now_s, name, done, total in told:
        clock.now_s = now_s
        shown.listen(name, done, total)
    return [line.strip() for line in console.export_text().splitlines()]


def test_a_log_has_a_line_at_a_stages_begin_and_end():
    assert lines((1.0, "Worlds", 0, 2), (1.5, "Worlds", 1, 2), (2.0, "Worlds", 2, 2)) == [
        "1.0 s  Worlds 0/2",
        "2.0 s  Worlds 2/2",
    ]


def test_a_stage_that_lasts_has_a_line_every_ten_seconds():
    told = [(float(second), "Episodes", second, 1_000) for second in range(35)]
    assert [line.rpartition(" ")[2] for line in lines(*told)] == ["0/1,000", "10/1,000", "20/1,000", "30/1,000"]


def test_what_was_said_is_not_said_again():
    assert (
        len(lines((0.0, "Worlds", 0, 2), (20.0, "Worlds", 0, 2), (21.0, "Worlds", 2, 2), (22.0, "Worlds", 2, 2))) == 2
    )


def test_a_file_gets_lines_while_the_run_goes_on():
    file = io.StringIO()
    with progress_bars(Console(file=file)) as listener:
        listener("Worlds", 0, 2)
        assert "Worlds 0/2" in file.getvalue()


def test_a_terminal_gets_bars():
    file = io.StringIO()
    with progress_bars(Console(file=file, force_terminal=True, width=100)) as listener:
        listener("Worlds", 1, 2)
    assert "1/2" in file.getvalue()
    assert " s  Worlds" not in file.getvalue()


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


PASSED = PipelineReport(run="run-1", name="nightly", stages=(stage(name="worldExport", arn=""),))
UNDECIDED = PASSED.model_copy(update={"verdict": "INCONCLUSIVE"})


def _wishes(folder: Path) -> CiWishes:
    asked = AskedRun("nightly", (folder / "store").as_uri())
    return CiWishes(folder / "nightly.yaml", asked, folder / "junit.xml", as_json=True)


def _end_by(exc: BaseException, wishes: CiWishes) -> None:
    with tell_ci(wishes):
        print("::set-output name=a::b")  # noqa: T201 - as a library may
        raise exc


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
        with tell_ci(_wishes(tmp_path)) as tell:
            tell(PASSED)
    else:
        with pytest.raises(type(end)):
            _end_by(end, _wishes(tmp_path))
    found = FullReport.model_validate_json(capsys.readouterr().out)  # nothing else is on stdout
    assert found.document == "nightly"
    assert (found.answer, found.exit_code, JUnitXml.fromfile(str(tmp_path / "junit.xml")).errors) == told


def test_a_file_that_cannot_be_written_is_refused_with_a_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    wishes = _wishes(tmp_path)._replace(junit=tmp_path)
    with pytest.raises(DocumentError, match="--junit"), tell_ci(wishes):
        pytest.fail("it has begun")
    found = FullReport.model_validate_json(capsys.readouterr().out)
    assert (found.answer, found.exit_code) == ("REFUSED", 2)


@pytest.mark.parametrize(
    "end", [PipelineNotPassed(UNDECIDED), StageFailed("InternalServiceError", "no answer"), RuntimeError("a defect")]
)
def test_a_file_that_cannot_be_written_any_more_hides_no_failure(
    end: Exception, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def run() -> None:
        with tell_ci(_wishes(tmp_path)):
            (tmp_path / "junit.xml").unlink()
            (tmp_path / "junit.xml").mkdir()
            raise end

    with pytest.raises(type(end)):
        run()
    assert "junit.xml cannot be written" in capsys.readouterr().err


def test_an_interrupted_run_leaves_a_file_that_says_that_it_has_not_ended(tmp_path: Path):
    with pytest.raises(SystemExit):
        _end_by(SystemExit(143), _wishes(tmp_path))
    assert "the run has not ended" in (tmp_path / "junit.xml").read_text()


def test_in_github_actions_there_are_a_summary_and_annotations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    with pytest.raises(StageFailed):
        _end_by(StageFailed("InternalServiceError", "no answer"), _wishes(tmp_path))
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
        _end_by(StageFailed("InternalServiceError", "no answer"), _wishes(tmp_path)._replace(as_json=False))
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines()[1] == "::set-output name=a::b"


def test_a_summary_that_cannot_be_written_changes_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "no" / "summary.md"))
    with tell_ci(_wishes(tmp_path)) as tell:
        tell(PASSED)
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


_WORLDS = ROOT / "examples/worlds-only.yaml"
_MODULES = """
import json, sys
from flows.cli.shell import app
try:
    app(sys.argv[1:])
except SystemExit as exc:
    assert not exc.code, exc.code
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def statuses(folder: Path) -> dict[str, list[tuple[str, str]]]:
    if not (folder / "store.json").exists():
        return {kind: [] for kind in JOB_KINDS}
    store = open_store(folder.as_uri())
    return {kind: [(each.id, each.status) for each in records(store, kind)] for kind in JOB_KINDS}


@pytest.mark.long
@pytest.mark.integration
def test_worlds_are_made_without_prefect_and_without_a_simulator(tmp_path: Path):
    command = [sys.executable, "-c", _MODULES, "run", "--direct", str(_WORLDS), "--store", tmp_path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    loaded = set(json.loads(done.stdout.splitlines()[-1]))
    assert loaded & {"prefect", "jax", "fastapi", "sqlalchemy"} == set()
    assert "Done" in done.stdout


@pytest.mark.integration
@pytest.mark.long
@pytest.mark.parametrize("first", ["--direct", ""], ids=["killed directly", "killed with a server"])
def test_either_way_continues_what_the_other_began(first: str, tmp_path: Path):
    file = write_document(tmp_path, {name: part for name, part in small_document().items() if name != "deployment"})
    store, second = tmp_path / "store", "" if first else "--direct"
    killed = simyard("run", *first.split(), str(file), "--store", store.as_uri())
    assert eventually(lambda: "Completed" in {status for _, status in statuses(store)["world-export-job"]})
    killed.kill()
    killed.communicate()
    began = statuses(store)
    done = finished("run", *second.split(), str(file), "--store", store.as_uri())
    assert done.returncode == 0, done.stderr
    ended = statuses(store)
    assert {kind: len(found) for kind, found in ended.items()} == {
        "world-generation-job": 1,
        "world-export-job": 1,
        "simulation-job-batch": 1,
        "deployment-job": 0,
        "pipeline-run": 1,
    }
    assert {status for found in ended.values() for _, status in found} == {"Completed"}
    assert [each for each, _ in began["pipeline-run"]] == [each for each, _ in ended["pipeline-run"]]


@pytest.mark.integration
def test_workers_of_a_cluster_are_refused_with_what_to_do(tmp_path: Path):
    done = finished("run", "--direct", str(_WORLDS), "--store", tmp_path.as_uri(), SIMYARD_WORKERS="dask:2")
    assert done.returncode == 2
    assert "SIMYARD_WORKERS" in done.stderr
    assert "--direct" in done.stderr
