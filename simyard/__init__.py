"""Simyard for Python and notebooks: documents run, planned and looked at. No other package imports it."""

from simyard.hidden_packages import require_own_packages

require_own_packages()

from simyard.batch import compare, gate, replay, report, results  # noqa: E402 - only where Simyard's own packages are found
from simyard.document import plan, run, validate  # noqa: E402 - same
from simyard.night import trend  # noqa: E402 - same
from simyard.world import worlds  # noqa: E402 - same

__all__ = ["compare", "gate", "plan", "replay", "report", "results", "run", "trend", "validate", "worlds"]
