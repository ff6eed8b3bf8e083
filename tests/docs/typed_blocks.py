"""Blocks of a page, typed as its reader types them."""

import os
import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from tests.repository import ROOT


def blocks_in(text: str, language: str) -> list[str]:
    """Returns the blocks of a page's text that are in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def blocks_of(page: str) -> list[tuple[str, str]]:
    """Returns the blocks of a page that can be typed, in their order: the language and the text of each."""
    return re.findall(r"^```(sh|python|sql|yaml)\n(.*?)^```$", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)


def begin_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes a folder the working directory, with what a reader has in the repository."""
    for name, target in ((".venv", Path(sys.prefix)), ("examples", ROOT / "examples")):
        (folder / name).symlink_to(target)
    monkeypatch.chdir(folder)


def typed(language: str, text: str) -> str:
    """Returns what a block says: a query's rows, a program's output; a document becomes ``document.yaml``."""
    if language == "yaml":
        Path("document.yaml").write_text(text)
        return ""
    if language == "sql":
        with duckdb.connect() as connection:
            return "\n".join(map(str, connection.execute(text).fetchall()))
    command = ["bash", "-euo", "pipefail", "-c", text] if language == "sh" else [sys.executable, "-c", text]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "300"})
    assert done.returncode == 0, done.stderr
    return done.stdout
