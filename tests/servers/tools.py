"""Programs and libraries that are not Python packages: a test that needs one says so, and cannot be left out in CI."""

import os
import shutil
from typing import NoReturn

import pytest


def is_ci() -> bool:
    """Says whether this is a CI run, which has every tool: `.ci/run` installs them."""
    return os.environ.get("CI", "").lower() in ("1", "true")


def need_tool(program: str, package: str = "", *, path: str | None = None) -> str:
    """Returns the path of a program; without it skips the test, or fails it in CI.

    Args:
        program: The name of the program.
        package: The Debian package that has it; the name of the program if empty.
        path: The folders to look in; those of this process if None.
    """
    found = shutil.which(program, path=path)
    if found is None:
        skip_or_fail(f"{program} is not installed: apt-get install {package or program}")
    return found


def skip_or_fail(reason: str) -> NoReturn:
    """Skips the test for a tool that is missing, or fails it in CI.

    Args:
        reason: What is missing, and how to get it.
    """
    if is_ci():
        pytest.fail(f"CI=true, and {reason}", pytrace=False)
    pytest.skip(reason)
