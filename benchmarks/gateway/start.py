"""How long a simulation job waits from the call of CreateSimulationJob until it is Running, with a warm worker.

    .venv/bin/python -m benchmarks.gateway.start [--jobs N]

`simyard serve` runs as a process, with a store in a new folder and a Prefect server of its own. A job is created when
the one before it has ended. The first one finds a worker that has never simulated, and is told apart. Running is what
DescribeSimulationJob answers: a worker has begun with the job's episode.
"""

import argparse
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from benchmarks.repository import ROOT
from specs.arn import arn
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.applications.registry import resolve
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.job.generation_job import run_generation_job

_ENDED = frozenset({"Completed", "Failed", "Canceled"})
_ROLE = "arn:aws:iam::000000000000:role/none"
_WARM_S = 120.0
Document = dict[str, Any]


def ask(port: int, operation: str, body: Mapping[str, Any]) -> Document:
    """Returns the answer to a call."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}/{operation}", json.dumps(body).encode())
    request.add_header("Content-Type", "application/json")
    with urllib.request.urlopen(request) as answer:  # noqa: S310 - its own gateway
        return json.load(answer)


def job_request(store: Store) -> Document:
    """Returns what CreateSimulationJob is asked: the courier in one apartment, whose world this makes."""
    token = "world"  # noqa: S105 - a request's
    counts = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    asked = {
        "clientRequestToken": token,
        "template": arn("world-template", store_id(store), "two"),
        "worldCount": counts,
    }
    template = TemplateBody.model_validate_json((ROOT / "examples/templates/two-rooms.json").read_bytes())
    made = run_generation_job(
        store,
        CreateWorldGenerationJobRequest.model_validate(asked),
        template,
        seed=7,
        token=token,
        progress=lambda _done, _total: None,
    )
    (world,) = cast("list[str]", made.detail["worlds"])
    robot = _use(store, "robot-application", "courier", "go_to_goal")
    scenario = _use(store, "simulation-application", "delivery", "rooms")
    scenario["worldConfigs"] = [{"world": arn("world", store_id(store), world)}]
    return {
        "iamRole": _ROLE,
        "maxJobDurationInSeconds": 5,
        "robotApplications": [robot],
        "simulationApplications": [scenario],
    }


def _use(store: Store, kind: Any, name: str, launch_file: str) -> Document:  # noqa: ANN401 - an application's kind
    resolve(store, kind, name)
    launch = {"packageName": name, "launchFile": launch_file}
    return {"application": arn(kind, store_id(store), name), "launchConfig": launch}


@contextmanager
def gateway(store: Store, folder: Path) -> Generator[int]:
    """Runs `simyard serve` in the block; yields its port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    command = [str(Path(sys.executable).with_name("simyard")), "serve", "--unsigned", "--port", str(port)]
    with (folder / "serve.log").open("wb") as log:
        process = subprocess.Popen(
            [*command, "--store", store.url],
            env={**os.environ, "PREFECT_HOME": str(folder / "prefect")},
            stdout=log,
            stderr=log,
        )
        try:
            yield port
        finally:
            process.terminate()
            process.wait()


def wait_s(port: int, request: Mapping[str, Any]) -> float:
    """Returns how many seconds a new job waits until it is Running; it has ended then."""
    began_s, running_s = time.perf_counter(), 0.0
    job = ask(port, "createSimulationJob", request)["arn"]
    while (status := ask(port, "describeSimulationJob", {"job": job})["status"]) not in _ENDED:
        if status == "Running" and not running_s:
            running_s = time.perf_counter() - began_s
            ask(port, "cancelSimulationJob", {"job": job})
        time.sleep(0.02)
    return running_s or time.perf_counter() - began_s


def _wait_for_gateway(port: int) -> None:
    end_s = time.monotonic() + _WARM_S
    while time.monotonic() < end_s:
        try:
            ask(port, "describeSimulationJob", {"job": "none"})
        except urllib.error.HTTPError:  # an answer
            return
        except OSError:
            time.sleep(0.1)
    raise TimeoutError("the gateway does not answer")


def main(jobs: int) -> None:
    """Prints the waits.

    Args:
        jobs: How many, besides the first.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store = open_store((folder / "store").as_uri())
        request = job_request(store)
        with gateway(store, folder) as port:
            _wait_for_gateway(port)
            first_s = wait_s(port, request)
            print(f"first {first_s:.2f} s", flush=True)
            waits_s = [wait_s(port, request) for _ in range(jobs)]
    waits_s.sort()
    shown = ", ".join(f"{each:.2f}" for each in waits_s)
    print(f"median {statistics.median(waits_s):.2f} s, worst {waits_s[-1]:.2f} s of {shown}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=20)
    main(parser.parse_args().jobs)
