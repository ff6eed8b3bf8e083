"""What a search varies: environment variables, each with its distribution where the robot will live; and its budget."""

from collections.abc import Iterator, Mapping
from typing import Annotated, cast

from pydantic import Field

from specs.data.result_columns import MEASURES
from specs.field_types import EnvironmentVariableValue, Integer, Number
from specs.pipeline.world_sections import Seed
from specs.rules import Finding, Ruled, part

MIN_SEARCHED, MAX_SEARCHED = 1_000, 1_000_000
_KINDS = ("uniform", "logUniform", "normal", "choice")


class Normal(Ruled):
    """A normal distribution, cut off where bounds are given.

    Attributes:
        mean: Before it is cut off.
        sd: The standard deviation before it is cut off, above 0.
        atLeast: No smaller value is drawn.
        atMost: No larger value is drawn.
    """

    mean: Number
    sd: Annotated[Number, Field(gt=0.0)]
    atLeast: Number | None = None
    atMost: Number | None = None

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields bounds that leave nothing."""
        low, high = _number(part(data, "atLeast")), _number(part(data, "atMost"))
        if low is not None and high is not None and low >= high:
            yield Finding(("atMost",), high, f"a number above atLeast, which is {low:g}")


class Distribution(Ruled):
    """How a variable is distributed: exactly one of its keys.

    Attributes:
        uniform: The least and the largest value; all between are as likely.
        logUniform: The same of the logarithm; both above 0.
        normal: Mean and standard deviation.
        choice: Values that are as likely as each other.
    """

    uniform: tuple[Number, Number] | None = None
    logUniform: tuple[Number, Number] | None = None
    normal: Normal | None = None
    choice: Annotated[tuple[EnvironmentVariableValue, ...], Field(min_length=2, max_length=100)] | None = None

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields more than one distribution, or none, and bounds that leave nothing."""
        given = [kind for kind in _KINDS if part(data, kind) is not None]
        if len(given) != 1:
            yield Finding((), ", ".join(given) or "none", f"exactly one of {', '.join(_KINDS)}")
        for kind in {"uniform", "logUniform"}.intersection(given):
            bounds = part(data, kind)
            if not isinstance(bounds, list | tuple) or len(cast("list[object]", bounds)) != 2:
                continue  # its type says so
            low, high = (_number(each) for each in cast("list[object]", bounds))
            if low is None or high is None:
                continue
            if low >= high:
                yield Finding((kind,), f"{low:g}, {high:g}", "two numbers, the first below the second")
            elif kind == "logUniform" and low <= 0.0:
                yield Finding((kind, 0), f"{low:g}", "a number above 0, of which there is a logarithm")


class Search(Ruled):
    """A search for rare failures, and how probable they are.

    Attributes:
        over: Environment variables of the batch's requests, each with its distribution. Worlds and seeds vary as well:
            each of the batch's worlds is as likely, and so is each seed.
        measure: A column that is below 0 in a failure, and near 0 close to one; an episode that did not pass is a
            failure whatever it says.
        episodes: How many may be simulated.
        confidence: Of the interval of the probability.
        seed: Everything that is drawn follows from it.
    """

    over: Annotated[dict[str, Distribution], Field(max_length=20)]
    measure: str = "min_clearance_m"
    episodes: Annotated[Integer, Field(ge=MIN_SEARCHED, le=MAX_SEARCHED)] = 20_000
    confidence: Annotated[Number, Field(ge=0.5, le=0.9999)] = 0.95
    seed: Seed = 0

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields a measure that is none, and what cannot be varied yet."""
        measure = part(data, "measure")
        if isinstance(measure, str) and measure not in MEASURES:
            yield Finding(("measure",), measure, f"one of {', '.join(MEASURES)}")
        over = part(data, "over")
        for name in cast("Mapping[str, object]", over) if isinstance(over, Mapping) else ():
            if "." in name:
                yield Finding(("over", name), name, "an environment variable: physical parameters are not searched yet")


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
