"""Simyard for Python and notebooks: documents run, planned and looked at. No other package imports it."""

from simyard.start import is_command, leave_quietly

if is_command():
    leave_quietly()

from simyard.hidden_packages import require_own_packages

require_own_packages()

from simyard.batch_calls import (  # noqa: E402 - only where Simyard's own packages are found
    compare,
    gate,
    replay,
    report,
    results,
    search,
    suite,
    trend,
)
from simyard.document_calls import plan, run, validate  # noqa: E402 - same
from simyard.worlds_of import world_import, worlds  # noqa: E402 - same

__all__ = [
    "compare",
    "gate",
    "plan",
    "replay",
    "report",
    "results",
    "run",
    "search",
    "suite",
    "trend",
    "validate",
    "world_import",
    "worlds",
]
