"""Imports MJX without the lines that it prints about optional packages."""

from contextlib import redirect_stdout
from io import StringIO

# Without warp, which only its GPU backend needs, MJX prints two lines to standard output when it is imported.
with redirect_stdout(StringIO()):
    from mujoco import mjx

__all__ = ["mjx"]
