"""Each checkout has a Prefect server of its own, and each kept server its port."""

import socket
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from tasks.server.resident import checkout_home, lasting_port, remember_port


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
