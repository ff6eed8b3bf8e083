"""`simyard serve` as a client meets it: the real command, on a port of 127.0.0.1."""

import http.client
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any

from tasks.gateway.access.access_keys import AccessKey, add_key, first_key
from tasks.gateway.rest_json import HttpRequest
from tests.gateway.signed_requests import signed_request
from tests.integration.runs import own_cache
from tests.repository import ROOT
from tests.servers.ports import free_port

NOBODY = b'{"fleet": "arn:aws:robomaker:us-west-2:123456789012:deployment-fleet/nobody"}'
"""A request that is answered in the same way whatever the store holds: 400, there is no such fleet."""


@dataclass(frozen=True)
class Served:
    """A gateway that runs.

    Attributes:
        port: Of 127.0.0.1.
        process: The id of its process.
        keys: The file with its keys.
        owner: The key with all rights; of nobody where it does not check signatures.
        store: The folder of its store.
    """

    port: int
    process: int
    keys: Path
    owner: AccessKey
    store: Path

    @property
    def host(self) -> str:
        """What clients ask for."""
        return f"127.0.0.1:{self.port}"

    def signed(
        self, target: str, body: bytes = b"{}", key: AccessKey | None = None, method: str = "POST"
    ) -> HttpRequest:
        """Returns a request that the owner signed, or whoever has another key."""
        by = key or self.owner
        return signed_request(method, target, body, secret=by.secret, key_id=by.key_id, host=self.host)

    def send(self, request: HttpRequest, *, raw_path: str | None = None) -> tuple[int, str]:
        """Returns status and error of the answer to a request, sent as it is."""
        status, error, _ = self._answered(request, raw_path)
        return status, error

    def call(self, target: str, members: Mapping[str, object], key: AccessKey | None = None) -> dict[str, Any]:
        """Returns the members of the answer to a call, which succeeds."""
        status, error, body = self._answered(self.signed(target, json.dumps(members).encode(), key))
        assert status == HTTPStatus.OK, (error, body)
        return json.loads(body)

    def _answered(self, request: HttpRequest, raw_path: str | None = None) -> tuple[int, str, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port)
        target = (raw_path or request.raw_path) + (f"?{request.query}" if request.query else "")
        connection.putrequest(request.method, target, skip_host=True, skip_accept_encoding=True)
        for name, value in request.headers:
            if name != "content-length":
                connection.putheader(name, value)
        connection.putheader("content-length", str(len(request.body)))
        connection.endheaders(request.body)
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        return answer.status, answer.getheader("x-amzn-errortype", ""), body

    def signed_in(self, key: AccessKey | None = None) -> str:
        """Returns the cookie of a browser that the owner, or whoever has another key, has signed in with."""
        by = key or self.owner
        form = f"key={by.key_id}&secret={by.secret}&back=/"
        connection = http.client.HTTPConnection("127.0.0.1", self.port)
        kind = "application/x-www-form-urlencoded"
        connection.request(
            "POST", "/sign-in", form, {"host": self.host, "origin": f"http://{self.host}", "content-type": kind}
        )
        cookie = connection.getresponse().getheader("set-cookie", "").partition(";")[0]
        connection.close()
        return cookie

    def page(self, target: str, cookie: str) -> tuple[int, str]:
        """Returns status and text of a page of the browser."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port)
        connection.request("GET", target, headers={"host": self.host, "cookie": cookie})
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        return answer.status, text

    def answers(self) -> bool:
        """Returns whether a client of this very address is answered."""
        return self.send(self.signed("/describeFleet", NOBODY)) == (400, "ResourceNotFoundException")

    def key(self, name: str, *rights: str, on: tuple[str, ...] = ()) -> AccessKey:
        """Returns a new key."""
        return add_key(self.keys, name, rights, on)

    def memory_mb(self) -> float:
        """Returns the largest memory that the process ever had."""
        text = Path(f"/proc/{self.process}/status").read_text()
        return int(text.partition("VmHWM:")[2].split()[0]) / 1024


@contextmanager
def served(
    folder: Path,
    *options: str,
    workers: int = 0,
    beside: Served | None = None,
    settings: Mapping[str, str] | None = None,
    python: str = sys.executable,
) -> Generator[Served]:
    """Yields a gateway.

    Args:
        folder: For its log, its cache and its files.
        options: Of `simyard serve`, in place of the keys.
        workers: How many batches it works on at once.
        beside: One whose store and keys it has; else it has new ones.
        settings: Variables of its environment.
        python: The interpreter of the version that is served.
    """
    folder.mkdir(parents=True, exist_ok=True)
    port = free_port()
    keys, owner, store = (beside.keys, beside.owner, beside.store) if beside else _new_yard(folder)
    environment = os.environ | {
        "SIMYARD_CACHE": own_cache(folder / "cache"),
        "PREFECT_HOME": str(folder / "prefect"),
        "PYTHONPATH": str(ROOT),
        **(settings or {}),
    }
    command = [python, "-m", "simyard", "serve", "--workers", str(workers), "--port", str(port)]
    how = [*(options or ("--access-keys", str(keys))), "--store", store.as_uri()]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen([*command, *how], env=environment, stdout=log, stderr=log, cwd=folder)
    try:
        await_answer(port, process, folder / "log")
        yield Served(port, process.pid, keys, owner, store)
    finally:
        process.terminate()
        process.wait()


def _new_yard(folder: Path) -> tuple[Path, AccessKey, Path]:
    keys, store = folder / "keys", folder / "store"
    owner = first_key(keys)
    assert owner is not None
    store.mkdir()
    return keys, owner, store


def await_answer(port: int, process: "subprocess.Popen[bytes]", log: Path) -> None:
    while process.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            time.sleep(0.1)
        else:
            return
    raise RuntimeError(log.read_text())
