"""A server that stays: found, ended, and one for each checkout."""

import json
import socket
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from specs.errors import StageFailed
from tasks.server import resident
from tasks.server.process import Server
from tasks.server.resident import checkout_home, end_kept, keep_server, kept_server, lasting_port, remember_port
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
    server = keep_server(tmp_path)
    assert keep_server(tmp_path) == server == kept_server(tmp_path)
    assert len(children) == 1


@pytest.mark.usefixtures("healthy", "children")
def test_the_port_of_a_kept_server_is_noted_for_its_next_start(tmp_path: Path):
    keep_server(tmp_path)
    assert lasting_port(tmp_path) == (int((tmp_path / "port").read_text()), "")


def test_an_interrupted_start_leaves_no_server(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    def interrupted(server: Server, child: subprocess.Popen[bytes]) -> None:
        assert json.loads((tmp_path / "kept.json").read_text())["pid"] == server.pid, "kill -9 now would orphan it"
        raise SystemExit(143)

    monkeypatch.setattr(resident, "wait_until_healthy", interrupted)
    with pytest.raises(SystemExit):
        keep_server(tmp_path)
    assert [child.poll() is not None for child in children] == [True]
    assert end_kept(tmp_path) is None


@pytest.mark.usefixtures("healthy")
def test_a_server_that_does_not_answer_is_ended(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    server = keep_server(tmp_path)
    monkeypatch.setattr(resident, "is_healthy", lambda _: False)
    assert end_kept(tmp_path) == server
    assert [child.poll() is not None for child in children] == [True]
    assert end_kept(tmp_path) is None


@pytest.mark.usefixtures("healthy")
def test_a_process_that_was_given_the_number_of_an_ended_server_is_left_alone(
    tmp_path: Path, children: list[subprocess.Popen[bytes]]
):
    keep_server(tmp_path)
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
    server = keep_server(tmp_path)
    answers = iter([False, False, True])
    monkeypatch.setattr(resident, "is_healthy", lambda _: next(answers))
    assert kept_server(tmp_path) == server


@pytest.mark.usefixtures("healthy")
def test_a_server_that_stays_silent_is_told_and_not_doubled(
    tmp_path: Path, children: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
):
    keep_server(tmp_path)
    monkeypatch.setattr(resident, "is_healthy", lambda _: False)
    with pytest.raises(StageFailed, match=r"simyard down.*its\.log"):
        kept_server(tmp_path, silent_s=0.0)


@pytest.mark.usefixtures("healthy")
def test_a_server_that_was_killed_is_no_longer_kept(tmp_path: Path, children: list[subprocess.Popen[bytes]]):
    keep_server(tmp_path)
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
    server = keep_server(tmp_path)
    try:
        assert Path(server.log).name == f"server-{server.pid}.log"
        assert keep_server(tmp_path) == server
    finally:
        ended = end_kept(tmp_path)
    assert ended == server
    assert kept_server(tmp_path) is None
    assert not resident.is_healthy(server.api_url)


def checkout(tmp_path: Path, name: str) -> Path:
    folder = tmp_path / name
    folder.mkdir(exist_ok=True)
    return folder


def test_two_checkouts_of_one_account_have_a_home_each_and_keep_it(tmp_path: Path):
    first, second = checkout(tmp_path, "a"), checkout(tmp_path, "b")
    homes = [checkout_home(tmp_path / "cache", each) for each in (first, second, first, second)]
    assert homes[0] == tmp_path / "cache" / "prefect"
    assert homes[1].name.startswith("prefect-")
    assert homes[:2] == homes[2:]


def test_the_home_of_a_checkout_that_is_gone_goes_to_the_next_one(tmp_path: Path):
    first, second = checkout(tmp_path, "a"), checkout(tmp_path, "b")
    checkout_home(tmp_path / "cache", first)
    first.rmdir()
    assert checkout_home(tmp_path / "cache", second).name == "prefect"


def test_a_checkout_that_has_a_home_keeps_it_when_the_first_one_is_gone(tmp_path: Path):
    first, second = checkout(tmp_path, "a"), checkout(tmp_path, "b")
    checkout_home(tmp_path / "cache", first)
    before = checkout_home(tmp_path / "cache", second)
    before.mkdir()
    first.rmdir()
    assert checkout_home(tmp_path / "cache", second) == before


@pytest.mark.long
def test_of_checkouts_that_come_at_once_one_gets_the_first_home(tmp_path: Path):
    folders = [checkout(tmp_path, f"c{number}") for number in range(6)]
    code = "import sys; from pathlib import Path; from tasks.server.resident import checkout_home\n"
    code += "print(checkout_home(Path(sys.argv[1]), Path(sys.argv[2])))"
    started = [
        subprocess.Popen([sys.executable, "-c", code, tmp_path / "cache", each], stdout=subprocess.PIPE, text=True)
        for each in folders
    ]
    homes = [process.communicate()[0].strip() for process in started]
    assert len(set(homes)) == 6
    assert sum(Path(home).name == "prefect" for home in homes) == 1


def test_where_nothing_can_be_written_the_first_home_is_named_and_nothing_fails(tmp_path: Path):
    (tmp_path / "cache").write_text("a file in the place of the folder")
    assert checkout_home(tmp_path / "cache", tmp_path) == tmp_path / "cache" / "prefect"


def test_a_kept_server_comes_back_at_the_port_that_it_had(tmp_path: Path):
    port, notice = lasting_port(tmp_path)
    assert notice == ""
    remember_port(tmp_path, port)
    assert lasting_port(tmp_path) == (port, "")


@pytest.fixture
def taken() -> Generator[int]:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def test_a_port_that_another_program_has_is_left_to_it_and_that_is_told(tmp_path: Path, taken: int):
    remember_port(tmp_path, taken)
    port, notice = lasting_port(tmp_path)
    assert port != taken
    assert f"another program has port {taken}" in notice


def test_a_port_that_was_left_a_moment_ago_is_free(tmp_path: Path):
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as asyncio does
        server.bind(("127.0.0.1", 0))
        server.listen()
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)):
            answered, _ = server.accept()
            answered.close()  # the server's side waits now, as after each request of a browser
    remember_port(tmp_path, port)
    assert lasting_port(tmp_path) == (port, "")


@pytest.mark.parametrize("text", ["", "x", "70000", "-1", "80"])
def test_a_port_that_is_none_is_forgotten(tmp_path: Path, text: str):
    (tmp_path / "port").write_text(text)
    port, notice = lasting_port(tmp_path)
    assert 1024 < port < 32768
    assert notice == ""
