"""docs/reference/http-api.md: its blocks run in order, its table of errors is the interface's."""

import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path
from typing import get_args

import pytest

from specs.arn import parse_reference
from specs.robomaker.operations import STATUSES, ErrorName
from tests.repository import ROOT
from tests.servers.ports import free_port

PAGE = (ROOT / "docs/reference/http-api.md").read_text()
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_table_has_every_error_with_its_status():
    rows = re.findall(r"^\| (\w+)Exception \| (\d+) \|", PAGE, re.MULTILINE)
    assert {name: int(status) for name, status in rows} == {
        name: STATUSES.get(name, 400) for name in get_args(ErrorName)
    }


def test_the_forms_of_an_arn_mean_the_same():
    rows = re.findall(r"^\| .+? \| `\.\.\.(:.+?)` \| `(.+?)` \|$", PAGE, re.MULTILINE)
    assert len(rows) == 3
    for old, own in rows:
        assert parse_reference(f"arn:aws:robomaker:us-west-2:123456789012{old}").path == own


@pytest.fixture
def environment(tmp_path: Path) -> Generator[dict[str, str]]:
    """The environment of a client, with a gateway at the port of its own."""
    port = free_port()
    found = {key: value for key, value in os.environ.items() if not key.startswith(("AWS_", "SIMYARD_"))}
    found |= {
        "HOME": str(tmp_path),
        "PATH": f"{Path(sys.executable).parent}:{found['PATH']}",
        "SIMYARD_STORE": (tmp_path / "store").as_uri(),
        "SIMYARD_CACHE": str(tmp_path / "cache"),
        "PORT": str(port),
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
    }
    command = [sys.executable, "-m", "simyard", "serve", "--unsigned", "--workers", "0", "--port", str(port)]
    with subprocess.Popen(command, cwd=ROOT, env=found, stdout=subprocess.DEVNULL) as server:
        while server.poll() is None and not listens(port):
            time.sleep(0.05)
        yield found
        server.terminate()
    assert server.returncode == 0


def listens(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.long
@pytest.mark.integration
def test_the_blocks_make_a_boto3_without_a_model_work(environment: dict[str, str], tmp_path: Path):
    assert [language for language, _ in BLOCKS] == ["sh", "sh", "python"]
    (tmp_path / "script.py").write_text(BLOCKS[-1][1])
    shell = "\n".join(code for language, code in BLOCKS if language == "sh").replace("8600", environment["PORT"])

    ended = subprocess.run(
        ["bash", "-euc", f"{shell}\ncd {tmp_path}\n{sys.executable} script.py"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )

    assert ended.returncode == 0, ended.stderr
