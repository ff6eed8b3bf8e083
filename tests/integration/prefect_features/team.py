"""A Prefect server with everything in prefect.yaml deployed, and a worker, as a team has them; one for all tests."""

import os
import signal
import subprocess
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tasks.server.process import Server, run_server, wait_until_healthy
from tests.integration.runs import own_cache
from tests.repository import ROOT


@dataclass(frozen=True)
class Team:
    """A server with Simyard's deployments, for programs that are told where it is."""

    environment: Mapping[str, str]
    folder: Path

    def run(self, *command: str, check: bool = True, more: Mapping[str, str] | None = None) -> str:
        """Returns what a program of the environment, started in the repository, wrote, its logs before its answer."""
        program = Path(sys.executable).with_name(command[0])
        done = subprocess.run(
            [str(program), *command[1:]],
            cwd=ROOT,
            env={**self.environment, **(more or {})},
            capture_output=True,
            text=True,
            check=False,
        )
        assert not check or done.returncode == 0, done.stdout + done.stderr
        return done.stderr + done.stdout

    @contextmanager
    def started(self, *command: str, **more: str) -> Generator[Path]:
        """Runs a program for the length of the block; yields its log."""
        log = self.folder / f"{Path(command[-1]).name}-{len(list(self.folder.iterdir()))}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                [str(Path(sys.executable).with_name(command[0])), *command[1:]],
                cwd=ROOT,
                env={**self.environment, **more},
                stdout=output,
                stderr=output,
            )
            try:
                yield log
            finally:
                process.send_signal(signal.SIGINT)
                process.wait()


@pytest.fixture(scope="session")
def team(tmp_path_factory: pytest.TempPathFactory) -> Generator[Team]:
    """A server of its own, with a pool and everything in prefect.yaml."""
    folder = tmp_path_factory.mktemp("team")
    with run_server(folder / "server") as (server, process):
        wait_until_healthy(server, process)
        made = Team(_environment(server, folder), folder)
        made.run("prefect", "work-pool", "create", "local", "--type", "process")
        made.run("prefect", "--no-prompt", "deploy", "--all")
        yield made


@pytest.fixture(scope="session")
def team_worker(team: Team) -> Generator[None]:
    """A worker that looks for runs once in two seconds."""
    with team.started("prefect", "worker", "start", "--pool", "local", PREFECT_WORKER_QUERY_SECONDS="2"):
        yield


def _environment(server: Server, folder: Path) -> dict[str, str]:
    return {
        **os.environ,
        **server.environment(),
        "PREFECT_HOME": str(folder / "home"),
        "PYTHONPATH": str(ROOT),
        "SIMYARD_STORE": (folder / "store").as_uri(),
        "SIMYARD_CACHE": own_cache(folder / "cache"),
    }
