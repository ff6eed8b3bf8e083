"""A registry's container image by RoboMaker's calls: application, version, job."""

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tests.flows.gateway.asked import Asked
from tests.repository import ROOT
from tests.servers.ports import free_port
from tests.storage.made_images import docker_archive, file, layer

_SUITE, _RUNTIME = {"name": "General"}, {"name": "SimulationRuntime"}
_ROBOT = (ROOT / "examples/ros/turtlebot3/robot.xml").read_bytes()
_CONFIG = """version: 0.1
storage: {{filesystem: {{rootdirectory: {folder}}}}}
http: {{addr: "127.0.0.1:{port}"}}
"""


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[str]:
    """A registry on this machine, by its address."""
    for name in ("docker-registry", "skopeo"):
        if shutil.which(name) is None:
            (pytest.fail if os.environ.get("CI") else pytest.skip)(f"apt-get install {name}")
    port = free_port()
    (tmp_path / "registry.yml").write_text(_CONFIG.format(folder=tmp_path / "registry", port=port))
    command = ["docker-registry", "serve", str(tmp_path / "registry.yml")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield f"127.0.0.1:{port}"
        finally:
            process.kill()


def pushed(archive: Path, registry: str, tmp_path: Path) -> str:
    """Returns the digest of an image that was pushed, once the registry takes it."""
    told = tmp_path / "digest"
    copy = ["skopeo", "--insecure-policy", "copy", "-q", "--dest-tls-verify=false", f"--digestfile={told}"]
    command = [*copy, f"docker-archive:{archive}", f"docker://{registry}/robot:1"]
    for _ in range(300):
        if subprocess.run(command, capture_output=True, check=False).returncode == 0:
            return told.read_text()
        time.sleep(0.2)
    pytest.fail("the registry takes no image")


@pytest.mark.long
def test_a_version_is_made_of_the_image_of_that_digest(
    gateway: Asked, registry: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("SIMYARD_REGISTRIES", registry)
    entries = (file("simyard/robot.xml", _ROBOT), file("usr/bin/roslaunch"))
    first = pushed(docker_archive(tmp_path / "1.tar", [layer(*entries)]), registry, tmp_path)
    second = pushed(docker_archive(tmp_path / "2.tar", [layer(*entries, file("more"))]), registry, tmp_path)
    uri = {"uri": f"{registry}/robot:1"}
    made = gateway.call("CreateRobotApplication", name="imaged", robotSoftwareSuite=_SUITE, environment=uri)
    version = gateway.call("CreateRobotApplicationVersion", application=made["arn"], imageDigest=first)
    assert (version["version"], version["environment"]) == ("1", uri)
    again = gateway.call("CreateRobotApplicationVersion", application=made["arn"], imageDigest=second)
    assert again["version"] == "2"
    with pytest.raises(DocumentError, match="skopeo"):
        gateway.call("CreateRobotApplicationVersion", application=made["arn"], imageDigest=f"sha256:{'0' * 64}")


@pytest.mark.parametrize("kind", ["Robot", "Simulation"])
def test_a_registry_that_nobody_has_named_is_not_asked(
    gateway: Asked, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.delenv("SIMYARD_REGISTRIES", raising=False)
    suites = {"robotSoftwareSuite": _SUITE, **({"simulationSoftwareSuite": _RUNTIME} if kind == "Simulation" else {})}
    uri = {"uri": "127.0.0.1:1/robot"}
    made = gateway.call(f"Create{kind}Application", name="imaged", environment=uri, **suites)
    with pytest.raises(DocumentError, match="SIMYARD_REGISTRIES has none; SIMYARD_REGISTRIES=127"):
        gateway.call(f"Create{kind}ApplicationVersion", application=made["arn"], imageDigest=f"sha256:{'0' * 64}")
