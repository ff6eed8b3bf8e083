"""The agent's wheel holds what the agent needs, and nothing that a robot has no use for."""

import sys
import zipfile
from io import BytesIO

import pytest

from tasks.deploy.kit.robot_kit import agent_requirements, agent_sources, agent_wheel, third_party, wheel_name

# What a distribution is imported as, where that is not its name.
HEAVY = ("jax", "prefect", "numpy", "mujoco", "scipy", "pyarrow")


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
    imported = third_party(agent_sources()) - set(sys.stdlib_module_names)

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
