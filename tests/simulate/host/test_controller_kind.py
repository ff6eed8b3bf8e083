"""How an application is driven follows from its files, without running any of them."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from tasks.simulate.host.declaration import controller_kind, launch_path

MAKES_ONE = "def controller(environment):\n    ...\n"
MAKES_ALL = "def controllers(environments):\n    ...\n"


def kind(folder: Path, files: dict[str, str], launch_file: str = "nav") -> str:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    launch = ApplicationLaunch(name="r", version="1", digest="0" * 64, package="nav", launch_file=launch_file)
    return controller_kind(folder, launch)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"jax = False\n{MAKES_ONE}", "plain"),
        (f'"""Text."""\nimport numpy\njax = False\n{MAKES_ONE}', "plain"),
        (f"jax = False\n{MAKES_ALL}", "batched"),
        (f"jax = False\n{MAKES_ONE}{MAKES_ALL}", "batched"),
        (MAKES_ALL, "jax"),
        ("import jax", "jax"),
        ("jax = True", "jax"),
        ("class A:\n    jax = False\n", "jax"),
        ("jax = no python (", "jax"),
        ("jax = False\x00", "jax"),
    ],
)
def test_a_module_is_what_it_says_at_its_top(tmp_path: Path, text: str, expected: str):
    assert kind(tmp_path, {"nav/nav.py": text}) == expected


def test_what_is_not_there_is_told_when_it_is_imported(tmp_path: Path):
    assert kind(tmp_path, {}) == "jax"


@pytest.mark.parametrize("launch_file", ["nav", "nav.onnx"])
def test_a_network_is_launched_in_place_of_a_module(tmp_path: Path, launch_file: str):
    assert kind(tmp_path, {"nav/nav.onnx": ""}, launch_file) == "onnx"


def test_a_module_comes_before_a_network_of_its_name(tmp_path: Path):
    assert kind(tmp_path, {"nav/nav.py": "", "nav/nav.onnx": ""}) == "jax"


@pytest.mark.parametrize(
    ("launch_file", "expected"), [("go.launch", "ros"), ("go.launch.py", "ros2"), ("go.launch.xml", "ros2")]
)
@pytest.mark.parametrize("folder", ["nav/launch", "nav", "src/nav/launch"])
def test_a_launch_file_of_ros_is_found_by_its_name(tmp_path: Path, folder: str, launch_file: str, expected: str):
    files = {f"{folder}/{launch_file}": "", "src/nav/package.xml": "<package/>"}
    assert kind(tmp_path, files, launch_file) == expected


def test_a_module_that_documents_from_before_call_a_launch_file_is_the_module(tmp_path: Path):
    assert kind(tmp_path, {"nav/go.py": ""}, "go.launch") == "jax"


def test_a_launch_file_above_its_bundle_is_none(tmp_path: Path):
    (tmp_path / "go.launch").write_text("")
    (tmp_path / "bundle/nav").mkdir(parents=True)
    launch = ApplicationLaunch(name="r", version="1", digest="0" * 64, package="nav", launch_file="../../go.launch")
    assert launch_path(tmp_path / "bundle", launch) is None


def test_a_module_is_parsed_once_until_it_is_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    parsed: list[object] = []
    parse = ast.parse
    monkeypatch.setattr(ast, "parse", lambda text: (parsed.append(text), parse(text))[1])
    plain = {"nav/nav.py": f"jax = False\n{MAKES_ONE}"}
    assert [kind(tmp_path, plain), kind(tmp_path, {}), kind(tmp_path, {})] == ["plain"] * 3
    assert len(parsed) == 1
    assert kind(tmp_path, {"nav/nav.py": MAKES_ONE}) == "jax"


def test_a_kind_is_read_without_jax():
    code = "import sys, tasks.simulate.host.declaration; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
