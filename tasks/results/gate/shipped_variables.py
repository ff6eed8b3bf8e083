"""The variables that robots get, compared with those that episodes had: what passed at half speed ships at half speed.

Episodes give a robot application all variables of its request, those of the scenario among them, and those of the
matrix. Which of them it reads, only the application knows. So all count: robots get each of them, with a value that
episodes had, all of them together; or the document says which do not, and why.
"""

from collections.abc import Iterable, Mapping, Sequence

from specs.base import Fault

Driven = Mapping[str, Sequence[str]]
"""The values that each variable took in some episodes that drove every combination of them."""

_PATH = "deployment.deploymentApplicationConfigs[0].launchConfig.environmentVariables"
_NAMED = "deployment.untestedVariables"
_VALUES_SHOWN = 8


def difference_faults(
    given: Mapping[str, str], driven: Iterable[Sequence[Driven]], named: Mapping[str, str]
) -> list[Fault]:
    """Returns a fault for each variable that differs and is not named, and for each that is named without need.

    Compared is with those episodes of each build that differ least.

    Args:
        given: The variables of the deployment's launch configuration.
        driven: What the episodes of each build that is deployed had.
        named: Why a variable differs, by name, as the document says.
    """
    nearest = _nearest(given, driven, named)
    differing = {name for had in nearest for name in _differing(given, had)} if nearest else set(named)
    unnamed = {name: [value for had in nearest for value in had.get(name, ())] for name in differing - named.keys()}
    return [
        *(_difference(name, given.get(name), list(dict.fromkeys(unnamed[name]))) for name in sorted(unnamed)),
        *(
            Fault(path=f"{_NAMED}.{name}", value=repr(reason), allowed="no entry: robots get it as episodes do")
            for name, reason in named.items()
            if name not in differing
        ),
    ]


def differing_names(given: Mapping[str, str], driven: Iterable[Sequence[Driven]]) -> list[str]:
    """Returns the variables that differ from what episodes had; arguments as there."""
    return sorted({name for had in _nearest(given, driven, ()) for name in _differing(given, had)})


def _nearest(given: Mapping[str, str], driven: Iterable[Sequence[Driven]], named: Iterable[str]) -> list[Driven]:
    expected = set(named)
    return [min(each, key=lambda had: len(_differing(given, had) ^ expected)) for each in driven if each]


def _differing(given: Mapping[str, str], had: Driven) -> set[str]:
    return {name for name in {*given, *had} if given.get(name) not in had.get(name, ())}


def _difference(name: str, given: str | None, values: Sequence[str]) -> Fault:
    shown = ", ".join(map(repr, values[:_VALUES_SHOWN])) + (", ..." if len(values) > _VALUES_SHOWN else "")
    allowed = f"a value that simulationBatch drives: {shown}" if values else "not set: simulationBatch does not set it"
    value = "not set" if given is None else repr(given)
    return Fault(path=f"{_PATH}.{name}", value=value, allowed=f"{allowed}; or {_NAMED}.{name}, with the reason")
