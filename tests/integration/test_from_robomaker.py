"""docs/guide/from-robomaker.md, as one types it: a script of boto3 alone, from a template to a fleet with an agent."""

import os
import re
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from tests.docs.typed_blocks import blocks_in
from tests.factories.gateway.served import await_answer
from tests.integration.runs import own_cache
from tests.repository import ROOT
from tests.servers.ports import free_port

pytestmark = [pytest.mark.integration, pytest.mark.long]
PAGE = (ROOT / "docs/guide/from-robomaker.md").read_text()
blocks = partial(blocks_in, PAGE)


@contextmanager
def typed(command: str, folder: Path, environment: dict[str, str]) -> "Generator[subprocess.Popen[bytes]]":
    """Runs a block that does not end by itself."""
    with (folder / f"{command.split()[1]}.log").open("wb") as log:
        process = subprocess.Popen(
            ["bash", "-euc", f"exec {command}"], cwd=folder, env=environment, stdout=log, stderr=log
        )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


@pytest.fixture
def environment(tmp_path: Path, prefect_server: str) -> dict[str, str]:
    """The environment of a user who has the repository and nothing else."""
    assert prefect_server
    for name in ("applications", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    own_cache(tmp_path / ".cache/simyard")
    own = {name: value for name, value in os.environ.items() if not name.startswith(("AWS_", "SIMYARD_", "XDG_"))}
    programs = f"{Path(sys.executable).parent}{os.pathsep}{own['PATH']}"
    return own | {"HOME": str(tmp_path), "PATH": programs, "PYTHONPATH": str(ROOT)}


def test_a_script_of_boto3_alone_goes_from_a_template_to_a_fleet(tmp_path: Path, environment: dict[str, str]):
    port = free_port()
    serve, agent = (block.replace("8600", str(port)) for block in (*blocks("serve"), *blocks("agent")))
    if os.getuid() == 0:
        agent = f"{agent.strip()} --user 0"  # pytest's folders let no other account in
    script = "\n".join([*blocks("sh"), "python tags.py"]).replace("8600", str(port))
    (tmp_path / "tags.py").write_text(*blocks("python"))
    with typed(serve, tmp_path, environment) as server, typed(agent, tmp_path, environment):
        await_answer(port, server, tmp_path / "serve.log")

        done = subprocess.run(
            ["bash", "-euc", script],
            env=environment,
            cwd=tmp_path,
            text=True,
            capture_output=True,
            check=False,
        )

    assert done.returncode == 0, done.stderr
    ended = re.findall(r":([a-z-]+)/[a-z]+-[0-9a-f]+: (Completed|Succeeded)$", done.stdout, re.MULTILINE)
    assert ended == [
        ("world-generation-job", "Completed"),
        ("world-export-job", "Completed"),
        ("simulation-job-batch", "Completed"),
        ("deployment-job", "Succeeded"),
        ("deployment-job", "Succeeded"),
    ]
    assert len(re.findall(r":simulation-job/sim-[0-9a-f]{16}\d: Completed \{'simyard:outcome': ", done.stdout)) == 4
    assert re.search(r":robot/courier-1[/0-9]*: InSync$", done.stdout, re.MULTILINE)
    assert re.search(r"^\d of 4 failed$", done.stdout, re.MULTILINE)
