"""A container image from a document to robots of this machine."""

import json
import os
import shutil
from pathlib import Path

import pytest

from tasks.deploy.step import agents_folder
from tasks.storage.store_url import open_store
from tests.integration.runs import finished
from tests.storage.made_images import docker_archive, file, layer, link

pytestmark = pytest.mark.integration
_DRIVE = b'#!/bin/sh\necho "$SPEED of $SIMYARD_ROBOT by $(id -u)" > "$HOME/seen"\nexec sleep 1000\n'
_LOOK = b'#!/bin/sh\nuntil [ -s "$HOME/seen" ]; do sleep 0.1; done\n'


def test_a_document_rolls_an_image_out_to_robots_of_this_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    busybox = shutil.which("busybox")
    if busybox is None or shutil.which("bwrap") is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("apt-get install busybox-static bubblewrap")
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    links = [link(f"bin/{name}", "busybox") for name in ("sh", "id", "sleep")]
    programs = [file("bin/busybox", Path(busybox).read_bytes()), *links]
    scripts = [file("app/drive", _DRIVE), file("app/look", _LOOK)]
    docker_archive(tmp_path / "app.tar", [layer(*programs), layer(*scripts)], {"User": "7"})
    launch = {
        "packageName": "app",
        "launchFile": "drive",
        "postLaunchFile": "look",
        "environmentVariables": {"SPEED": "0.2"},
    }
    document = {
        "name": "image",
        "applications": [{"name": "roamer", "source": "app.tar"}],
        "deployment": {
            "fleet": {"name": "roamers", "localAgents": 2},
            "deploymentApplicationConfigs": [{"application": "roamer", "launchConfig": launch}],
        },
    }
    (tmp_path / "image.yaml").write_text(json.dumps(document))
    store = (tmp_path / "store").as_uri()

    done = finished("run", str(tmp_path / "image.yaml"), "--direct", SIMYARD_STORE=store)

    assert done.returncode == 0, done.stdout + done.stderr
    seen = [path.read_text() for path in agents_folder(open_store(store)).rglob("seen")]
    assert sorted(seen) == [f"0.2 of roamers-{number} by 7\n" for number in (1, 2)]
