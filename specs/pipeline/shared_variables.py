"""The variables that a request's robot and scenario share: an episode has one environment, which both see.

RoboMaker kept them apart, in containers of their own. Here one column, one sweep and one line of evidence stand for a
variable, so two values under one name are refused instead of one of them being dropped.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import cast

from specs.rules import Finding, items, part

_ROBOT, _SCENARIO = "robotApplications", "simulationApplications"
_LAUNCH, _VARIABLES = "launchConfig", "environmentVariables"


def two_values(requests: Sequence[object], sweep: object) -> Iterator[Finding]:
    """Yields the variables that a request's robot and scenario give different values.

    Args:
        requests: As the document has them, right or wrong.
        sweep: The matrix's variables, whose values both applications get instead of their own.
    """
    for number, request in enumerate(requests):
        robot, scenario = _variables(request, _ROBOT), _variables(request, _SCENARIO)
        for name in sorted((robot.keys() & scenario.keys()) - _mapping(sweep).keys()):
            if robot[name] != scenario[name]:
                yield _finding(number, name, robot[name], scenario[name])


def never_driven(requests: Sequence[object], sweep: object) -> Iterator[str]:
    """Yields the variables of robots and scenarios whose value the matrix replaces and never drives.

    Args:
        requests: As the document has them.
        sweep: The matrix's variables, each with its values.
    """
    values = _mapping(sweep)
    for request in requests:
        for field in (_ROBOT, _SCENARIO):
            for name, value in _variables(request, field).items():
                driven = values.get(name)
                if driven is not None and value not in items(driven):
                    yield f"createSimulationJobRequests[*].{field}[*].{_LAUNCH}.{_VARIABLES}.{name}"


def _finding(number: int, name: str, robots: object, scenarios: object) -> Finding:
    other = f"createSimulationJobRequests[{number}].{_ROBOT}[0].{_LAUNCH}.{_VARIABLES}.{name}"
    allowed = f"{robots!r} as in {other}, or another name: robot and scenario see the same variables"
    loc = ("createSimulationJobRequests", number, _SCENARIO, 0, _LAUNCH, _VARIABLES, name)
    return Finding(loc, scenarios, allowed)


def _variables(request: object, field: str) -> Mapping[str, object]:
    use = next(iter(items(part(request, field))), None)
    return _mapping(part(part(use, _LAUNCH), _VARIABLES))


def _mapping(data: object) -> Mapping[str, object]:
    return cast("Mapping[str, object]", data) if isinstance(data, Mapping) else {}
