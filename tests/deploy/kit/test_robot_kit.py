"""What an owner carries to a robot: the wheel, the installer, the unit, the settings."""

import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.deploy.kit.robot_kit import (
    _imports,
    agent_requirements,
    agent_sources,
    agent_wheel,
    wheel_name,
    write_kit,
)
from tests.deploy.kit.robot_image import command, install
from tests.servers.tools import need_tool

# What a distribution is imported as, where that is not its name.
HEAVY = ("jax", "prefect", "numpy", "mujoco", "scipy", "pyarrow")
URL = "file:///srv/store"


def test_it_holds_the_agent_and_what_it_imports_late() -> None:
    sources = agent_sources()

    assert {
        "tasks/deploy/robot/agent.py",
        "tasks/storage/backends/s3.py",
        "tasks/deploy/trust/verification.py",
        "specs/__init__.py",
    } <= set(sources)


def test_it_holds_nothing_of_the_simulator_or_the_controller() -> None:
    assert not [name for name in agent_sources() if name.startswith(("flows", "tasks/simulate", "tasks/worlds"))]
    assert "tasks/deploy/rollout/controller.py" not in agent_sources()


def test_it_imports_only_what_it_asks_for() -> None:
    asked = {requirement.partition(">")[0].partition("[")[0].partition("<")[0] for requirement in agent_requirements()}
    named = {name.partition(".")[0] for source in agent_sources().values() for name in _imports(source)}
    imported = named - {"specs", "tasks", "flows"} - set(sys.stdlib_module_names)

    # Two come with another: pydantic_core with pydantic, aiohttp with s3fs.
    assert imported - {"pydantic_core", "aiohttp"} == asked


@pytest.mark.parametrize("name", HEAVY)
def test_it_asks_for_nothing_heavy(name: str) -> None:
    assert not [requirement for requirement in agent_requirements() if requirement.startswith(name)]


def test_it_is_the_same_bytes_each_time() -> None:
    assert agent_wheel() == agent_wheel()


def test_its_record_lists_every_file() -> None:
    with zipfile.ZipFile(BytesIO(agent_wheel())) as wheel:
        (record,) = [name for name in wheel.namelist() if name.endswith("RECORD")]
        listed = [line.partition(",")[0] for line in wheel.read(record).decode().splitlines()]

        assert listed == wheel.namelist()
        assert record.split(".dist-info")[0] == "-".join(wheel_name().split("-")[:2])


def test_it_holds_the_agent_the_installer_the_unit_the_store_and_the_root_of_trust(tmp_path: Path) -> None:
    written = write_kit(tmp_path / "kit", store_url=URL, root_of_trust=b"{}")

    assert {path.name for path in written} == {
        wheel_name(),
        "install.sh",
        "simyard-agent@.service",
        "agent.env",
        "root.json",
    }
    assert (tmp_path / "kit/root.json").read_bytes() == b"{}"
    assert f"SIMYARD_STORE={URL}\n" in (tmp_path / "kit/agent.env").read_text()


def test_an_older_kit_gives_way_and_its_root_of_trust_with_it(tmp_path: Path) -> None:
    write_kit(tmp_path, store_url=URL, root_of_trust=b"{}")
    (tmp_path / "simyard_agent-0.0.1-py3-none-any.whl").write_bytes(b"older")

    write_kit(tmp_path, store_url=URL, root_of_trust=None)

    assert not (tmp_path / "root.json").exists()
    assert [path.name for path in tmp_path.glob("*.whl")] == [wheel_name()]
    settings = (tmp_path / "agent.env").read_text()
    assert "--unsigned" in settings
    assert "UNSIGNED" in settings


@pytest.mark.parametrize("name", ["thesis.pdf", "simyard_agent-notes.txt"])
def test_a_folder_with_something_else_in_it_is_refused_and_left_alone(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")

    with pytest.raises(DocumentError, match="older kit"):
        write_kit(tmp_path, store_url=URL, root_of_trust=None)

    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.long
def test_installing_again_keeps_the_robots_settings(tmp_path: Path) -> None:
    kit, image = tmp_path / "kit", tmp_path / "image"
    write_kit(kit, store_url=URL, root_of_trust=None)
    install(kit, image, "r1")
    (image / "etc/simyard/agent.env").write_text('SIMYARD_STORE=file:///elsewhere\nSIMYARD_TRUST="--unsigned"\n')

    install(kit, image, "r1")

    assert "--store file:///elsewhere --unsigned" in " ".join(command(image, "r1"))


def test_the_installer_wants_a_robot(tmp_path: Path) -> None:
    write_kit(tmp_path / "kit", store_url=URL, root_of_trust=None)

    done = subprocess.run([str(tmp_path / "kit/install.sh")], check=False, capture_output=True, text=True)

    assert (done.returncode, "ROBOT" in done.stderr) == (2, True)


def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    write_kit(tmp_path, store_url=URL, root_of_trust=None)
    unit = tmp_path / "simyard-agent@.service"
    unit.write_text(unit.read_text().replace("/opt/simyard-agent/bin/simyard-agent", "/bin/true"))

    analyze = need_tool("systemd-analyze", "systemd")
    done = subprocess.run([analyze, "verify", str(unit)], check=False, capture_output=True, text=True)

    assert (done.returncode, done.stderr) == (0, "")
