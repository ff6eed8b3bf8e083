"""Whatever the README tells one to type, typed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.runs import ROOT

README = (ROOT / "README.md").read_text()
# Under a drawing, so that its dark lines can be seen on GitHub's dark theme, which ignores a background in a style.
GROUND = '<rect width="100%" height="100%" fill="#fff"/>'


def blocks(language: str) -> list[str]:
    """Returns the README's code blocks of a language, in order."""
    parts = re.split(r"^```(.*)$\n?", README, flags=re.MULTILINE)
    # Text, language, code, the closing fence's empty language, text, ...
    return [code for name, code in zip(parts[1::4], parts[2::4], strict=True) if name == language]


@pytest.fixture
def checkout(small_run: Path, tmp_path: Path) -> Path:
    """Returns a folder like a clone after `make run`: environment, examples, and a store with a run in it."""
    folder = tmp_path / "checkout"
    shutil.copytree(small_run / ".simyard", folder / ".simyard", symlinks=True)
    for name, target in (
        (".venv", Path(sys.prefix)),
        ("examples", ROOT / "examples"),
        ("applications", ROOT / "applications"),
    ):
        (folder / name).symlink_to(target)
    return folder


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("block", blocks("sh"))
def test_each_shell_block_succeeds_line_by_line(checkout: Path, block: str):
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block], cwd=checkout, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("block", blocks("python"))
def test_each_python_block_runs(checkout: Path, block: str):
    done = subprocess.run([sys.executable, "-c", block], cwd=checkout, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "worldGeneration Completed 2 worlds" in done.stdout


def test_the_first_screen_has_two_commands_and_they_do_what_it_says():
    (first,) = blocks("")
    commands = [line.split("#")[0].split() for line in first.splitlines()]
    assert commands == [["make", "run"], ["make", "test"]]
    environment = {**os.environ, "MAKEFLAGS": ""}
    plans = [
        subprocess.run(
            ["make", "--no-print-directory", "-n", command[1]],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        )
        for command in commands
    ]
    assert plans[0].stdout.splitlines()[-1] == ".venv/bin/simyard run examples/quickstart.yaml"
    # What it leaves out is marked, or whole documents, attacks and promises; `make test-all` runs these as well.
    left_out = " ".join(f"--ignore=tests/{folder}" for folder in ("integration", "attacks", "deploy/promises"))
    quick = f".venv/bin/pytest --numprocesses 3 --dist loadgroup -m 'not long' {left_out}"
    assert plans[1].stdout.splitlines()[-1] == quick


def test_every_file_that_the_readme_links_to_is_there():
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert len(links) > 5
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_every_block_has_a_test():
    languages = re.findall(r"^```(\w+)$", README, flags=re.MULTILINE)
    assert set(languages) == {"sh", "python", "deployments"}


@pytest.mark.long
@pytest.mark.integration
def test_the_picture_is_what_the_preview_draws(checkout: Path):
    command = next(line for block in blocks("sh") for line in block.splitlines() if "world preview" in line)
    subprocess.run(["bash", "-c", command], cwd=checkout, check=True)
    shown = (ROOT / "docs/pictures/world.svg").read_text()
    assert (checkout / ".simyard/plan.svg").read_text() == shown.replace(GROUND, "")


def test_every_drawing_has_a_ground_below_all_else():
    drawings = sorted((ROOT / "docs").rglob("*.svg"))
    assert drawings
    for path in drawings:
        before, ground, _ = path.read_text().partition(GROUND)
        assert ground, path
        assert before.endswith("</style>"), path
