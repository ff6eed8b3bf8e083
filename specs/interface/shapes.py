"""The shapes of RoboMaker's requests and answers by name: every document class of `specs.robomaker`."""

from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Annotated, Any, Literal, get_origin

from specs import field_types
from specs.base import Spec
from specs.robomaker import (
    applications,
    deployment,
    fleet,
    launch,
    simulation,
    simulation_descriptions,
    tags,
    world_descriptions,
    world_jobs,
)

_MODULES: tuple[ModuleType, ...] = (
    field_types,
    applications,
    deployment,
    fleet,
    launch,
    simulation,
    simulation_descriptions,
    tags,
    world_descriptions,
    world_jobs,
)


@cache
def shapes() -> Mapping[str, type[Spec]]:
    """Returns the document class of each shape that is a structure, and of what several of them have in common."""
    return {
        name: value
        for module in _MODULES
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Spec) and value.__module__ == module.__name__
    }


@cache
def aliases() -> Mapping[str, Any]:
    """Returns the types of texts, numbers, lists and maps that have the name of a shape, by name."""
    return {
        name: value
        for module in _MODULES
        for name, value in vars(module).items()
        if get_origin(value) in {Annotated, Literal, tuple} and not name.startswith("_")
    }
