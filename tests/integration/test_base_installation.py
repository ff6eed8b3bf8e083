"""What `pip install simyard` brings, without any extra, is enough for all that asks for no extra."""

import os
import subprocess
import sys
import tomllib
from importlib.metadata import distribution, packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.integration.runs import own_cache, small_document, write_document
from tests.repository import ROOT

# In a sitecustomize.py, so that it holds in the processes that a command starts as well.
HIDING = """
from importlib.machinery import PathFinder

found_otherwise = PathFinder.find_spec
PathFinder.find_spec = lambda name, path=None, target=None: (
    None if path is None and name in {hidden} else found_otherwise(name, path, target)
)
"""

PACKAGES = ("specs", "tasks", "flows", "simyard")
# Modules that are only imported where an extra is there, or where its lack is told.
OF_EXTRAS = (
    "simyard.gym",
    "tasks.export.format.usd",
    "tasks.results.playback.replay_mcap",
    "tasks.results.playback.replay_video",
    "tasks.ros.bag.bag_file",
    "tasks.ros.lockstep.ros2_lockstep",
    "tasks.ros.ros2.dds_node",
    "tasks.ros.ros2.interface_types",
    "tasks.ros.ros2.navigation_client",
    "tasks.ros.ros2.robot_links",
    "tasks.ros.ros2.ros2_node",
    "tasks.ros.ros2.topic_watch",
)


def brought() -> set[str]:
    """Returns the distributions that come without an extra: those of pyproject.toml, and what they need in turn."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = {("simyard", ""), *asked(project["dependencies"], "")}
    known: set[tuple[str, str]] = set()
    while wanted:
        known |= (new := {wanted.pop()})
        for name, extra in new - {("simyard", "")}:
            wanted |= asked(distribution(name).requires or (), extra) - known
    return {name for name, _ in known}


def asked(requirements: list[str] | tuple[str, ...], extra: str) -> set[tuple[str, str]]:
    """Returns the names that requirements ask for here, each without an extra and with those that they name."""
    needs = [Requirement(each) for each in requirements]
    return {
        (canonicalize_name(need.name), each)
        for need in needs
        if need.marker is None or need.marker.evaluate({"extra": extra})
        for each in ("", *need.extras)
    }


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Returns the environment of an installation without extras."""
    here = brought()
    hidden = {
        module
        for module, names in packages_distributions().items()
        if not here & {canonicalize_name(name) for name in names}
    }
    assert {"rosbags", "mcap", "pytest", "gymnasium"} <= hidden
    folder = tmp_path_factory.mktemp("site")
    (folder / "sitecustomize.py").write_text(HIDING.format(hidden=sorted(hidden)))
    return {**os.environ, "PYTHONPATH": f"{folder}:{ROOT}"}


def done(bare: dict[str, str], *command: str | Path) -> str:
    """Returns what a command prints, which is done."""
    ended = subprocess.run([sys.executable, *command], env=bare, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


IMPORTS = """
import importlib, sys
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ImportError:
        print(name)
"""


@pytest.mark.long
def test_only_what_an_extra_is_for_needs_it(bare: dict[str, str]):
    files = [path.relative_to(ROOT) for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    names = [".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in files]
    refused = set(done(bare, "-c", IMPORTS, *names).split())
    assert {name for name in refused if not name.startswith(OF_EXTRAS)} == set()


@pytest.mark.long
@pytest.mark.integration
def test_a_document_is_checked_planned_and_run(bare: dict[str, str], tmp_path: Path):
    bare["SIMYARD_CACHE"] = own_cache(tmp_path / "cache")
    store = ("--store", (tmp_path / "store").as_uri())
    document = small_document(worldExport=None, deployment=None)
    file = write_document(tmp_path, {name: value for name, value in document.items() if value})
    simyard = ("-m", "simyard")
    assert "valid" in done(bare, *simyard, "validate", file)
    assert "48 worlds" in done(bare, *simyard, "plan", ROOT / "examples/quickstart.yaml", *store)
    done(bare, *simyard, "run", file, "--direct", *store)
