"""A server that stays: found, waited for and ended by what it is, not by how quickly it answers."""

import json
import subprocess
from collections.abc import Generator
from pathlib import Path

import pytest

from specs.errors import StageFailed
from tasks.server import resident
from tasks.server.process import Server
from tasks.server.resident import end_kept, keep, kept_server, lasting_port
from tests.factories.gateway.answering_server import NOBODY, answering


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch) -> Generator[list[subprocess.Popen[bytes]], None, None]:
    """What was launched; a launch starts a program that answers nowhere."""
    launched: list[subprocess.Popen[bytes]] = []

    def launch(home: Path, *, bound: bool, port: int) -> tuple[Server, subprocess.Popen[bytes]]:
        assert not bound
        launched.append(subprocess.Popen(["sleep", "600"]))
        return Server(api_url=NOBODY, pid=launched[-1].pid, log="its.log"), launched[-1]

    monkeypatch.setattr(resident, "launch", launch)
    yield launched
    for child in launched:
        child.kill()
        child.wait()


@pytest.fixture
def healthy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every server answers."""
    monkeypatch.setattr(resident, "is_healthy", lambda _: True)
    monkeypatch.setattr(resident, "wait_until_healthy", lambda *_: None)


@pytest.mark.usefixtures("healthy")
def test_a_kept_server_is_kept_once(tmp_path: Path, children: list[subprocess.Popen[bytes]]):
    server = keep(tmp_path)
    assert keep(tmp_path) == server == kept_server(tmp_path)
    assert len(children) == 1


@pytest.mark.usefixtures("healthy", "children")
def test_the_port_of_a_kept_server_is_noted_for_its_next_start(tmp_path: Path):
    keep(tmp_path)
    assert lasting_port(tmp_path) == (int((tmp_path / "port").read_text()), "")


def test_an_interrupted_start_leaves_no_server(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    def interrupted(server: Server, child: subprocess.Popen[bytes]) -> None:
        assert json.loads((tmp_path / "kept.json").read_text())["pid"] == server.pid, "kill -9 now would orphan it"
        raise SystemExit(143)

    monkeypatch.setattr(resident, "wait_until_healthy", interrupted)
    with pytest.raises(SystemExit):
        keep(tmp_path)
    assert [child.poll() is not None for child in children] == [True]
    assert end_kept(tmp_path) is None


@pytest.mark.usefixtures("healthy")
def test_a_server_that_does_not_answer_is_ended(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    server = keep(tmp_path)
    monkeypatch.setattr(resident, "is_healthy", lambda _: False)
    assert end_kept(tmp_path) == server
    assert [child.poll() is not None for child in children] == [True]
    assert end_kept(tmp_path) is None


@pytest.mark.usefixtures("healthy")
def test_a_process_that_was_given_the_number_of_an_ended_server_is_left_alone(
    tmp_path: Path, children: list[subprocess.Popen[bytes]]
):
    keep(tmp_path)
    note = json.loads((tmp_path / "kept.json").read_text())
    note["process"]["started"] = "1"
    (tmp_path / "kept.json").write_text(json.dumps(note))
    assert kept_server(tmp_path) is None
    assert end_kept(tmp_path) is None
    assert [child.poll() for child in children] == [None]


@pytest.mark.usefixtures("healthy")
def test_a_server_that_is_slow_for_a_moment_is_still_the_kept_one(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    server = keep(tmp_path)
    answers = iter([False, False, True])
    monkeypatch.setattr(resident, "is_healthy", lambda _: next(answers))
    assert kept_server(tmp_path) == server


@pytest.mark.usefixtures("healthy")
def test_a_server_that_stays_silent_is_told_and_not_doubled(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    keep(tmp_path)
    monkeypatch.setattr(resident, "is_healthy", lambda _: False)
    with pytest.raises(StageFailed, match=r"simyard down.*its\.log"):
        kept_server(tmp_path, silent_s=0.0)


@pytest.mark.usefixtures("healthy")
def test_a_server_that_was_killed_is_no_longer_kept(tmp_path: Path, children: list[subprocess.Popen[bytes]]):
    keep(tmp_path)
    children[0].kill()
    children[0].wait()
    assert kept_server(tmp_path) is None


def test_a_note_of_another_machine_counts_only_while_its_server_answers(tmp_path: Path):
    elsewhere = {"host": "another kernel", "pid": 1, "started": "1"}
    with answering() as api_url:
        note = {"api_url": api_url, "pid": 1, "log": "its.log", "process": elsewhere}
        (tmp_path / "kept.json").write_text(json.dumps(note))
        assert kept_server(tmp_path) == Server(api_url=api_url, pid=1, log="its.log")
    assert kept_server(tmp_path) is None


@pytest.mark.long
@pytest.mark.integration
def test_a_real_server_is_kept_found_again_and_ended(tmp_path: Path):
    server = keep(tmp_path)
    try:
        assert Path(server.log).name == f"server-{server.pid}.log"
        assert keep(tmp_path) == server
    finally:
        ended = end_kept(tmp_path)
    assert ended == server
    assert kept_server(tmp_path) is None
    assert not resident.is_healthy(server.api_url)
