"""MJX, imported without what it prints about packages that it can do without."""

from contextlib import redirect_stdout
from io import StringIO

# Without warp, which only its GPU backend needs, MJX prints two lines to standard output when it is imported.
with redirect_stdout(StringIO()):
    from mujoco import mjx

__all__ = ["mjx"]
