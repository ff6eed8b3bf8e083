"""docs/operate/gateway.md: its commands run; its rights, kinds and limits are the program's."""

import configparser
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from flows.gateway.application import MOST_BODY_BYTES
from specs.arn import KINDS
from tasks.gateway.access.access_keys import RIGHTS, read_keys
from tasks.gateway.connections import Bounds
from tests.factories.gateway.served import await_answer
from tests.repository import ROOT
from tests.servers.ports import free_port

DOCUMENT = (ROOT / "docs/operate/gateway.md").read_text()
BASH = ["bash", "-euo", "pipefail", "-c"]


def block(language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", DOCUMENT, flags=re.MULTILINE | re.DOTALL)
    return found


def rows(heading: str) -> dict[str, str]:
    part = DOCUMENT.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    return dict(re.findall(r"^\| ([^|]+) \| ([^|]+) \|", part, flags=re.MULTILINE))


@pytest.mark.long
@pytest.mark.integration
def test_what_it_says_one_types_makes_keys_and_shows_what_was_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [each for each in os.environ if each.startswith(("AWS_", "SIMYARD_ACCESS"))]:
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    monkeypatch.setenv("SIMYARD_STORE", (tmp_path / "store").as_uri())
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    port = free_port()
    server = subprocess.Popen([*BASH, f"exec {block('serve').replace('8600', str(port))}"], stdout=subprocess.PIPE)
    try:
        await_answer(port, server, Path(os.devnull))
        first, *rest = block("sh").replace("8600", str(port)).splitlines()
        call = "import boto3; print(boto3.client('robomaker').create_fleet(name='home')['arn'])"
        typed = "\n".join([first, "export AWS_DATA_PATH=models", f'python -c "{call}"', *rest])
        done = subprocess.run([*BASH, typed], check=False, capture_output=True, text=True)
    finally:
        server.terminate()
        told, _ = server.communicate()

    assert done.returncode == 0, done.stderr
    assert "deployment-fleet/home" in done.stdout
    assert "revoked nightly" in done.stdout
    assert '"operation": "CreateFleet", "outcome": "done"' in done.stdout
    secrets = {key.name: key.secret for key in read_keys(tmp_path / "settings/simyard/access-keys").values()}
    assert secrets["default"] not in done.stdout
    assert f"# simyard access export default --url http://127.0.0.1:{port}" in told.decode().splitlines()
    assert not [each for each in secrets.values() if each in told.decode()]


def test_the_command_with_tls_names_both_files() -> None:
    done = subprocess.run(
        [*BASH, block("tls").replace("simyard", f"{sys.executable} -m simyard", 1)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "PEM files that belong to each other" in done.stderr


def test_the_rights_are_the_programs() -> None:
    assert set(re.findall(r"^\| `(\w+)` \|", DOCUMENT, flags=re.MULTILINE)) == {*RIGHTS}


def test_the_kinds_that_it_names_are_there() -> None:
    named = DOCUMENT.partition("Kinds are those of ARNs:")[2].partition(". ")[0]
    kinds = set(re.findall(r"`([a-z-]+)`", named))
    assert kinds == {*KINDS} - {"pipeline-run", "deployment-job"}


def test_the_limits_are_the_programs() -> None:
    said, bounds = rows("Limits"), Bounds()
    assert said["connections"].startswith(f"{bounds.open}; {bounds.of_client} from one address")
    assert f"{bounds.head_s} s" in said["head of a request"]
    assert f"{MOST_BODY_BYTES >> 20} MiB" in said["body"]
    assert f"{bounds.request_s} s" in said["body"]
    assert said["an answer that is not read"] == f"{bounds.answer_s} s"
    assert said["an idle connection"] == f"{bounds.idle_s} s"


def test_the_unit_is_one() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment]
    unit.read_string(block("ini"))
    assert unit["Service"]["ExecStart"].endswith("simyard serve")
    assert {"Unit", "Service", "Install"} == {*unit.sections()}
