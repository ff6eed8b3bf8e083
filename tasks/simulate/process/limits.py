"""How long a call of an application's code may take, by a clock on the wall."""

from collections.abc import Mapping

from specs.settings import import_limit_s, step_limit_s
from tasks.simulate.application.call_clock import CallKind, RunningCall

# Compiling the largest program takes minutes on a slow machine; nobody waits for it an hour.
_COMPILE_LIMIT_S = 3600.0
# Lock-step ends an application that hangs by itself, after seconds; starting those of many lanes takes minutes.
_NODES_LIMIT_S = 900.0


def overdue(call: RunningCall) -> str:
    """Returns that a call takes too long, for a person; empty as long as it does not."""
    limits: Mapping[CallKind, tuple[float, str]] = {
        "import": (import_limit_s(), "SIMYARD_IMPORT_LIMIT_S"),
        "call": (step_limit_s(), "SIMYARD_STEP_LIMIT_S"),
        "slice": (step_limit_s(), "SIMYARD_STEP_LIMIT_S"),
        "compile": (max(_COMPILE_LIMIT_S, step_limit_s()), "SIMYARD_STEP_LIMIT_S"),
        "nodes": (max(_NODES_LIMIT_S, step_limit_s()), "SIMYARD_STEP_LIMIT_S"),
    }
    limit_s, name = limits[call.kind]
    return f"{call.what} took longer than {limit_s:g} s ({name})" if call.seconds > limit_s else ""
