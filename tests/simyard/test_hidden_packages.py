"""What hides Simyard's packages is named, with what to do, wherever it is found first."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.repository import ROOT

USE = "import simyard; print(simyard.hidden_packages.PACKAGES)"


def run(folder: Path, *command: str, script: str = USE, **variables: str) -> subprocess.CompletedProcess[str]:
    """Runs Python in a folder that is no checkout, with Simyard on its path as installed packages are: last."""
    (folder / "script.py").write_text(script)
    after = (
        "import os, sys\n"
        "elsewhere = [each for each in sys.path if not os.path.isdir(os.path.join(each, 'simyard'))]\n"
        f"sys.path[:] = [*elsewhere, {str(ROOT)!r}]"  # this checkout, also where another one is installed
    )
    site = folder / "site"
    site.mkdir(exist_ok=True)
    (site / "sitecustomize.py").write_text(after)
    path = os.pathsep.join(filter(None, [variables.get("PYTHONPATH", ""), str(site)]))
    return subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def told(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode != 0, done.stdout
    return done.stderr.strip().splitlines()[-1]


@pytest.mark.parametrize("name", ["tasks", "specs", "flows"])
def test_a_module_beside_a_script_is_named_with_the_remedy(tmp_path: Path, name: str):
    (tmp_path / f"{name}.py").touch()
    said = told(run(tmp_path, "script.py"))
    assert said.startswith(f"ImportError: {tmp_path / name}.py hides Simyard's package `{name}`, ")
    assert f"to `my_{name}`" in said
    assert "start Python with -P (or PYTHONSAFEPATH=1)" in said


def test_a_package_beside_a_script_is_named(tmp_path: Path):
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks/__init__.py").touch()
    assert told(run(tmp_path, "script.py")).startswith(f"ImportError: {tmp_path / 'tasks'} hides Simyard's package")


def test_the_remedy_helps(tmp_path: Path):
    (tmp_path / "tasks.py").touch()
    assert run(tmp_path, "-P", "script.py").returncode == 0


def test_the_folder_of_a_module_run_by_name_counts_likewise(tmp_path: Path):
    (tmp_path / "flows.py").touch()
    assert "hides Simyard's package `flows`" in told(run(tmp_path, "-m", "script"))


def test_what_is_on_pythonpath_is_told_to_be_taken_out(tmp_path: Path):
    own = tmp_path / "own"
    own.mkdir()
    (own / "specs.py").touch()
    said = told(run(tmp_path, "script.py", PYTHONPATH=str(own)))
    assert f"{own / 'specs.py'} hides Simyard's package `specs`" in said
    assert f"or take {own} out of PYTHONPATH" in said


def test_without_pythonpath_the_remedy_is_that_of_a_script(tmp_path: Path):
    (tmp_path / "tasks.py").touch()
    (tmp_path / "script.py").write_text(
        "import os, sys\n"
        "elsewhere = [each for each in sys.path if not os.path.isdir(os.path.join(each, 'simyard'))]\n"
        f"sys.path[:] = [*elsewhere, {str(ROOT)!r}]\n{USE}"
    )
    unset = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "script.py"]
    said = told(subprocess.run(command, cwd=tmp_path, env=unset, capture_output=True, text=True, check=False))
    assert "start Python with -P" in said
    assert "out of PYTHONPATH" not in said


def test_a_folder_without_init_hides_nothing(tmp_path: Path):
    (tmp_path / "tasks").mkdir()
    assert run(tmp_path, "script.py").returncode == 0


def test_what_a_program_has_imported_before_is_named(tmp_path: Path):
    (tmp_path / "tasks.py").touch()
    said = told(run(tmp_path, "script.py", script=f"import tasks\n{USE}"))
    assert said.startswith(f"ImportError: this program has imported {tmp_path / 'tasks.py'} as `tasks`")
    assert "rename yours, such as to `my_tasks`, and restart Python" in said


def test_a_module_made_by_hand_is_named_too(tmp_path: Path):
    script = f"import sys, types; sys.modules['specs'] = types.ModuleType('specs')\n{USE}"
    assert "this program has imported" in told(run(tmp_path, "script.py", script=script))


def test_the_command_says_it(tmp_path: Path):
    (tmp_path / "tasks.py").touch()
    assert "hides Simyard's package `tasks`" in told(run(tmp_path, "-m", "simyard", "--help"))


@pytest.mark.parametrize("command", [("-m", "simyard"), ("simyard",)])
def test_the_command_says_it_in_one_line_and_not_with_the_exit_code_of_a_gate(tmp_path: Path, command: tuple[str, ...]):
    (tmp_path / "tasks.py").touch()
    (tmp_path / "simyard").write_text("from simyard.__main__ import main\nmain()")  # as the installed script has it
    done = run(tmp_path, *command)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{tmp_path / 'tasks.py'} hides Simyard's package `tasks`")
    assert done.stderr.count("\n") == 1


def test_a_program_that_imports_it_sees_an_error_that_it_can_catch(tmp_path: Path):
    (tmp_path / "tasks.py").touch()
    script = "try:\n    import simyard\nexcept ImportError as exc:\n    print(exc.name)"
    assert run(tmp_path, "script.py", script=script).stdout == "tasks\n"


@pytest.mark.long
def test_the_entrypoint_of_a_deployment_says_it(tmp_path: Path):
    (tmp_path / "flows.py").write_text("from prefect import flow")
    load = "from prefect.flows import load_flow_from_entrypoint as f; f('simyard.flow.pipeline')"
    assert "hides Simyard's package `flows`" in told(run(tmp_path, "-c", load))
