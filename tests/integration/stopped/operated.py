"""A server and a worker as docs/operate/operations.md has them set up: by the units and environments in deploy/."""

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Generator, Mapping
from configparser import RawConfigParser
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from tasks.server.health import authorization, is_healthy
from tests.integration.runs import ROOT
from tests.servers.eventually import eventually

T = TypeVar("T")
ENDED = ("COMPLETED", "FAILED", "CRASHED", "CANCELLED")


def environment(name: str, **own: str) -> dict[str, str]:
    """Returns the variables of ``deploy/<name>.env``, those of this machine in place of the example's."""
    lines = (ROOT / "deploy" / f"{name}.env").read_text().splitlines()
    found = dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))
    assert own.keys() <= found.keys()
    return {**found, **own}


def unit(name: str) -> Mapping[str, str]:
    """Returns what ``deploy/<name>.service`` says of the service."""
    parser = RawConfigParser(strict=False)
    parser.optionxform = str  # pyright: ignore[reportAttributeAccessIssue]
    parser.read(ROOT / "deploy" / f"{name}.service")
    return parser["Service"]


@contextmanager
def started(name: str, variables: Mapping[str, str], log: Path) -> Generator[subprocess.Popen[bytes]]:
    """Runs what a unit starts, as the unit stops it."""
    service = unit(name)
    program, *arguments = service["ExecStart"].split()
    with log.open("ab") as output:
        process = subprocess.Popen(
            [str(Path(sys.executable).with_name(Path(program).name)), *arguments],
            env={**os.environ, **variables},
            cwd=ROOT,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        process.send_signal(getattr(signal, service.get("KillSignal", "SIGTERM")))
        try:
            process.wait(float(service.get("TimeoutStopSec", "30")))
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def until(reached: Callable[[], T | None]) -> T:
    """Returns what a server tells in the end; it is asked once a second."""
    return eventually(reached, every_s=1.0)


def wait_until_healthy(api_url: str, process: subprocess.Popen[bytes], log: Path) -> None:
    """Returns once the server answers."""

    def healthy() -> bool:
        assert process.poll() is None, log.read_text()[-4000:]
        return is_healthy(api_url)

    until(healthy)


def asked(api_url: str, path: str, body: object = None) -> Any:  # noqa: ANN401 - what the server answers
    """Returns what the server answers to a GET, or with a body to a POST."""
    request = urllib.request.Request(  # noqa: S310 - the test server's own URL
        f"{api_url}{path}",
        None if body is None else json.dumps(body).encode(),
        {"content-type": "application/json", **authorization(os.environ.get("PREFECT_API_AUTH_STRING", ""))},
    )
    with urllib.request.urlopen(request) as reply:  # noqa: S310 - same
        return json.load(reply)


def begun_run(api_url: str, deployment: str, parameters: Mapping[str, object]) -> str:
    """Returns the id of a new flow run of a deployment, such as ``pipeline/nightly``."""
    found = asked(api_url, f"/deployments/name/{deployment}")
    return str(asked(api_url, f"/deployments/{found['id']}/create_flow_run", {"parameters": parameters})["id"])


def ended_run(api_url: str, run: str) -> dict[str, Any]:
    """Returns a flow run when it has ended."""

    def ended() -> dict[str, Any] | None:
        found = asked(api_url, f"/flow_runs/{run}")
        return found if found["state_type"] in ENDED else None

    return until(ended)


def prefect(variables: Mapping[str, str], *arguments: str) -> None:
    """Runs Prefect's command in the repository, with variables beside those of this process."""
    program = str(Path(sys.executable).with_name("prefect"))
    done = subprocess.run(
        [program, *arguments], cwd=ROOT, env={**os.environ, **variables}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def commands(document: str, language: str) -> list[list[str]]:
    """Returns what a document's block says to type, word by word."""
    (block,) = re.findall(rf"^ *```{language}\n(.*?)^ *```", (ROOT / document).read_text(), re.MULTILINE | re.DOTALL)
    return [line.split() for line in block.splitlines() if line and not line.startswith("#")]
