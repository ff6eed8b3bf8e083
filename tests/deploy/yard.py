"""A store with one fleet and bundles to deploy to it, for tests that run real agents."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from specs.arn import arn
from specs.robomaker.bundle import Version
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import store_id
from tests.servers.eventually import eventually

FLEET = "couriers"
STAYS_UP = '#!/bin/sh\necho up >> "$HOME/launches"\nexec sleep 1000\n'
PATIENCE_S = 60.0


@dataclass
class Yard:
    """Attributes: calls: what progress was told, as (ended, all)."""

    store: Store
    folder: Path
    calls: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])

    def publish(self, scripts: Mapping[str, str], padding_bytes: int = 0) -> Version:
        """Publishes a bundle whose package ``courier`` holds the scripts, all executable."""
        package = self.folder / f"bundle-{time.monotonic_ns()}" / "courier"
        package.mkdir(parents=True)
        for name, text in scripts.items():
            (package / name).write_text(text)
            (package / name).chmod(0o755)
        if padding_bytes:
            (package / "padding").write_bytes(os.urandom(padding_bytes))
        return publish_bundle(self.store, "robot-application", "courier", package.parent)

    def request(self, version: Version, token: str, **launch: object) -> CreateDeploymentJobRequest:
        identifier = store_id(self.store)
        return CreateDeploymentJobRequest.model_validate(
            {
                "clientRequestToken": token,
                "fleet": arn("deployment-fleet", identifier, FLEET),
                "deploymentConfig": {"concurrentDeploymentPercentage": 40, "failureThresholdPercentage": 40},
                "deploymentApplicationConfigs": [
                    {
                        "application": arn("robot-application", identifier, "courier"),
                        "applicationVersion": str(version.number),
                        "launchConfig": {"packageName": "courier", "launchFile": "run.sh", **launch},
                    }
                ],
            }
        )

    def deploy(self, version: Version, token: str, *, agents: int = 0, **launch: object) -> JobRecord:
        """Returns the ended job; with agents, they are started for it and end with it."""
        folder = self.folder / "robots"
        return run_deployment_job(
            self.store,
            self.request(version, token, **launch),
            digest=version.digest,
            token=token,
            progress=lambda ended, robots: self.calls.append((ended, robots)),
            robots=partial(local_agents, self.store, FLEET, agents, folder, grace_s=0.2) if agents else None,
        )

    def start_agent(self, robot: str, trust: str = "--unsigned", **variables: str) -> subprocess.Popen[bytes]:
        root = self.root(robot)
        root.mkdir(parents=True, exist_ok=True)
        pace = ["--poll-s=0.05", "--longest-poll-s=0.1", "--grace-s=0.3", f"--user={os.geteuid()}", trust]
        argv = [
            "-m",
            "tasks.deploy.robot.agent",
            f"--robot={robot}",
            f"--root={root}",
            f"--store={self.store.url}",
            *pace,
        ]
        with (root / "agent.log").open("ab") as log:
            return subprocess.Popen([sys.executable, *argv], stdout=log, stderr=log, env={**os.environ, **variables})

    def root(self, robot: str) -> Path:
        return self.folder / "robots" / robot

    def current(self, robot: str) -> str:
        """Returns the digest that the robot's link shows; an empty text when there is none; fails when it is broken."""
        link = self.root(robot) / "current"
        if not link.is_symlink():
            return ""
        assert (link / "courier" / "run.sh").is_file(), "current is broken"
        return link.readlink().name


def desired_state(**changes: object) -> Desired:
    """Returns what a robot is asked for, where a test says nothing else."""
    fields: Mapping[str, object] = {
        "robot": "r1",
        "deployment": "dep-1",
        "sequence": 1,
        "epoch": 1,
        "application": "courier",
        "version": 1,
        "digest": "0" * 64,
        "launch": {"packageName": "courier", "launchFile": "run.sh"},
        "environment": {},
        "timeout_s": 60.0,
        "issued_at_s": 0.0,
    }
    return Desired.model_validate({**fields, **changes})


def wait_for_report(yard: Yard, robot: str, wanted: Callable[[Reported], bool]) -> Reported:
    def look() -> Reported | None:
        reported = read_reported(yard.store, robot)
        return reported if reported and wanted(reported) else None

    return eventually(look)


def programs_of(root: Path) -> list[str]:
    """Returns the command lines of everything that agents on a robot's folder started and that lives.

    A shell that is about to become another program is waited for: on a busy machine it outlasts a launch's grace.
    """
    found: list[str] = []

    def look() -> bool:
        found[:] = [command_line(Path("/proc") / str(pid)) for pid in marked_by(root)]
        return not any(map(_becomes_another, found))

    eventually(look)
    return found


def _becomes_another(command: str) -> bool:
    """Returns whether a command is a shell with a script of ours that ends in an exec."""
    script = Path(command.rpartition(" ")[2])
    return command.startswith("/bin/sh ") and script.is_file() and "\nexec " in script.read_text()


def marked_by(root: Path) -> list[int]:
    """Returns the processes that agents on a robot's folder started and that live."""
    mark = f"SIMYARD_ROBOT_ROOT={root}".encode()
    return [int(process.name) for process in Path("/proc").glob("[0-9]*") if mark in _variables(process)]


def command_line(process: Path) -> str:
    """Returns the command of a process's folder in /proc; an empty text for one that has ended."""
    try:
        return (process / "cmdline").read_bytes().replace(b"\0", b" ").decode().strip()
    except OSError:
        return ""


def _variables(process: Path) -> list[bytes]:
    try:
        return (process / "environ").read_bytes().split(b"\0")
    except OSError:
        return []


def kill(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()
