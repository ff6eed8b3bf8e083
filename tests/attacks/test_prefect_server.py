"""Who reaches the port of a Prefect server that Simyard started. No store is attacked, so none is made."""

import json
import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path

import pytest
from websockets.exceptions import InvalidHandshake
from websockets.sync.client import connect
from websockets.typing import Origin

from tasks.server.health import authorization
from tests.attacks.conftest import Owner
from tests.integration.runs import small_document, write_document
from tests.servers.eventually import eventually

PAGE = "https://evil.example"
# A work pool of the type that runs shell commands, as the README makes one.
POOL = json.dumps({"name": "theirs", "type": "process"})


@dataclass(frozen=True)
class Server:
    """A server, as who found its port sees it.

    Attributes:
        port: Of 127.0.0.1.
        password: What the owner was given; nothing by old versions.
    """

    port: int
    password: str = ""

    def asked(self, method: str, path: str, body: str = "", **headers: str) -> tuple[int, Mapping[str, str]]:
        """Returns status and headers of an answer; underscores in names of headers are hyphens."""
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        with closing(HTTPConnection("127.0.0.1", self.port)) as connection:
            connection.request(method, path, body or None, {"content-type": "application/json", **given})
            with connection.getresponse() as answer:
                return answer.status, {name.lower(): value for name, value in answer.getheaders()}

    def owner(self) -> dict[str, str]:
        """Returns the header with the password."""
        return authorization(self.password)


@pytest.fixture(scope="module")
def without_server(tmp_path_factory: pytest.TempPathFactory) -> Owner:
    """An owner who has no Prefect server yet."""
    folder = tmp_path_factory.mktemp("up")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "SIMYARD_"))}
    if os.environ.get("SIMYARD_ATTACKED"):
        environment.pop("PYTHONPATH", None)
    own = {"PREFECT_HOME": str(folder / "prefect"), "SIMYARD_CACHE": str(folder / "cache")}
    return Owner((folder / "store").as_uri(), folder, {**environment, **own})


@pytest.fixture(scope="module")
def up(without_server: Owner) -> Iterator[Server]:
    """The server of `simyard up`."""
    told = "\n".join(line for line in without_server.simyard("up").stdout.splitlines() if line.startswith("export "))
    variables = ["bash", "-c", f'{told}\nprintf "%s\\n" "$PREFECT_API_URL" "$PREFECT_API_AUTH_STRING"']
    url, password = subprocess.run(variables, capture_output=True, text=True, check=False).stdout.splitlines()
    yield Server(int(re.findall(r":(\d+)/api", url)[0]), password)
    without_server.simyard("down")


def test_a_page_whose_name_was_made_to_lead_here_is_refused(up: Server):
    """A web page rebinds its own name to 127.0.0.1 and makes a work pool: a request by any other name is refused."""
    status, _ = up.asked("POST", "/api/work_pools/", POOL, Host=f"evil.example:{up.port}", **up.owner())
    assert status == 403


def test_a_page_of_another_origin_is_refused(up: Server):
    """A web page sends a request across origins: one with a foreign Origin is refused, whatever it carries."""
    status, _ = up.asked("POST", "/api/work_pools/", POOL, Origin=PAGE, **up.owner())
    assert status == 403


@pytest.mark.parametrize("origin", [PAGE, "null", "http://localhost:4200", "http://127.0.0.1.evil.example"])
def test_a_browser_is_not_told_that_another_origin_may_ask(up: Server, origin: str):
    """A browser asks first whether a page may send a request: no page but the server's own is told so."""
    asks = {"Access_Control_Request_Method": "POST", "Access_Control_Request_Headers": "content-type"}
    status, headers = up.asked("OPTIONS", "/api/work_pools/", Origin=origin, **asks)
    assert (status, headers.get("access-control-allow-origin")) == (403, None)


@pytest.mark.parametrize("path", ["/api/events/in", "/api/events/out", "/api/logs/out"])
def test_a_page_of_another_origin_opens_no_websocket(up: Server, path: str):
    """A web page opens a WebSocket, which no browser asks about first: one with a foreign Origin is refused."""
    with (
        pytest.raises(InvalidHandshake, match="403"),
        connect(f"ws://127.0.0.1:{up.port}{path}", origin=Origin(PAGE), proxy=None),
    ):
        pass


def test_who_has_no_password_makes_no_work_pool(up: Server):
    """Another account of the machine asks the port without a password: it is told 401."""
    assert up.asked("POST", "/api/work_pools/", POOL)[0] == 401
    assert up.asked("POST", "/api/work_pools/", POOL, **authorization("simyard:guessed"))[0] == 401


def test_no_other_page_may_show_the_pages_in_a_frame(up: Server):
    """A web page shows Prefect's own pages in a frame and has the owner click: a browser is told not to show them."""
    assert up.asked("GET", "/", Accept="text/html")[1].get("x-frame-options") == "DENY"


def test_other_accounts_of_the_machine_find_no_password(up: Server, without_server: Owner):
    """Another account reads files and command lines: what holds the password, or jobs, is its owner's alone."""
    home = Path(without_server.environment["PREFECT_HOME"])
    held = [home / "password", *home.glob("prefect.db*")]
    assert [path.stat().st_mode & 0o077 for path in held] == [0] * len(held)
    pid = json.loads((home / "kept.json").read_text())["pid"]
    assert up.password not in Path(f"/proc/{pid}/cmdline").read_text()


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_the_owner_is_let_in(up: Server, name: str):
    """The owner, who has the password, uses the pages at both names, and the API."""
    host = f"{name}:{up.port}"
    assert up.asked("GET", "/", Accept="text/html", Host=host)[0] in {200, 307}
    asked = {"Host": host, "Origin": f"http://{host}", **up.owner()}
    status, headers = up.asked("POST", "/api/work_pools/filter", "{}", **asked)
    assert (status, headers["access-control-allow-origin"]) == (200, f"http://{host}")
    assert up.asked("GET", "/api/health", Host=host)[0] == 200


def test_the_server_of_a_run_asks_for_a_password_too(without_server: Owner, tmp_path: Path):
    """Another account asks the server that a run started for itself: it has its own password, on no command line."""
    document = small_document()
    worlds = {"name": "worlds", "worldGeneration": document["worldGeneration"]}
    home = tmp_path / "prefect"
    run = without_server.start("run", str(write_document(tmp_path, worlds)), PREFECT_HOME=str(home))
    try:
        (log,) = eventually(lambda: [*home.glob("server-*.log")])
        words = Path("/proc", log.stem.removeprefix("server-"), "cmdline")
        port = int(eventually(lambda: re.findall(r"\0(\d{4,5})\0", words.read_text()))[-1])
        status = eventually(lambda: _status(Server(port)))
    finally:
        run.terminate()
        run.communicate()
    assert status == 401
    assert [path.stat().st_mode & 0o077 for path in home.glob("prefect.db*")][:1] in ([], [0])


def _status(server: Server) -> int:
    try:
        return server.asked("GET", "/api/admin/version")[0]
    except OSError:
        return 0
