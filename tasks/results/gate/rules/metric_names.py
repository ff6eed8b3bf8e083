"""The names of metrics in rules, held against those that scenarios measure; loads no statistics."""

import json
from collections.abc import Sequence

from specs.base import Fault
from specs.data.result_columns import MEASURES
from specs.pipeline.gate_section import Gate
from specs.rules import nearest

PREFIX = "metrics."
"""What stands before a metric's name in a rule."""


def metric_faults(gate: Gate, known: Sequence[str]) -> list[Fault]:
    """Returns a fault for each rule about a metric that is not among those that are known."""
    return [
        Fault(
            path=f"gate.quantiles[{number}].column",
            value=json.dumps(asked.column),
            allowed=metric_rule(asked.column.removeprefix(PREFIX), known),
        )
        for number, asked in enumerate(gate.quantiles or ())
        if asked.column.startswith(PREFIX) and asked.column.removeprefix(PREFIX) not in known
    ]


def metric_rule(name: str, known: Sequence[str]) -> str:
    """Returns which metrics a rule may ask for, the one that was probably meant first."""
    close = name if name in MEASURES else f"{PREFIX}{near}" if (near := nearest(name, known)) else ""
    hint = f'did you mean "{close}"? ' if close else ""
    if not known:
        return f"{hint}one of {', '.join(MEASURES)}; the scenario measures nothing by itself"
    return f"{hint}the scenario measures {', '.join(f'{PREFIX}{each}' for each in known)}"
