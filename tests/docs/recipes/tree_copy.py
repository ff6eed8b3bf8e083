"""A copy of the source tree, to follow the recipes of CONTRIBUTING.md on."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.repository import ROOT

_PARTS = ("specs", "tasks", "flows", "applications")
_PATH = re.compile(r"`((?:specs|tasks|flows)/[\w/.]+)`")


def recipe_places(thing: str) -> set[str]:
    """The source files and folders that the recipe "How to add <thing>" of CONTRIBUTING.md names."""
    section = (ROOT / "CONTRIBUTING.md").read_text().split(f"## How to add {thing}\n")[1].split("\n## ")[0]
    return set(_PATH.findall(section))


class TreeCopy:
    """The source, free to be changed: what is changed is counted, and programs run on it."""

    def __init__(self, folder: Path) -> None:
        self.root = folder
        self.touched = set[str]()
        for part in _PARTS:
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))

    def write(self, path: str, text: str) -> None:
        """Makes a new file."""
        assert not (self.root / path).exists(), path
        (self.root / path).parent.mkdir(exist_ok=True)
        (self.root / path).write_text(text)
        self.touched.add(path)

    def replace(self, path: str, old: str, new: str) -> None:
        """Replaces what stands once in a file."""
        text = (self.root / path).read_text()
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {path}"
        (self.root / path).write_text(text.replace(old, new))
        self.touched.add(path)

    def add_before(self, path: str, mark: str, text: str) -> None:
        """Writes text before what stands once in a file."""
        self.replace(path, mark, text + mark)

    def run(self, code: str) -> str:
        """Returns what a program prints that runs on the copy."""
        environment = {
            **os.environ,
            "PYTHONPATH": f"{self.root}{os.pathsep}{ROOT}",
            "SIMYARD_CACHE": str(self.root / "cache"),
        }
        ended = subprocess.run(
            [sys.executable, "-c", code], cwd=self.root, env=environment, capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr[-3000:]
        return ended.stdout

    def followed(self, thing: str) -> None:
        """Checks that the changes are where the recipe says, in at most three files."""
        places = recipe_places(thing)
        for path in self.touched:
            assert any(path == place or path.startswith(place.rstrip("/") + "/") for place in places), (path, places)
        assert len(self.touched) <= 3, sorted(self.touched)
