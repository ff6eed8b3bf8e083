"""The section of a pipeline that searches: what varies, distributed as where the robot will live, and for how long."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, cast

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from specs.base import Spec
from specs.data.physics import OF_GOALS, OF_START, PHYSICAL, RANGES, no_such_people
from specs.data.result_columns import MEASURES
from specs.field_types import EnvironmentVariableValue, Integer, Number
from specs.pipeline.world_sections import Seed
from specs.robomaker.deployment import DeploymentVersion
from specs.rules import Finding, Ruled, Within, items, part

MIN_SEARCHED, MAX_SEARCHED = 1_000, 1_000_000
MAX_DISTINCT = 100
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


class SearchFind(Spec):
    """Which failures are reported.

    Attributes:
        distinct: At most so many that are unlike each other; each is simulated twice more, beside the budget.
        episodes: How many are simulated near failures that were met, to meet others, beside the budget.
    """

    distinct: Annotated[Integer, Field(ge=1, le=MAX_DISTINCT)] = 20
    # A search without any has the digest, and so the steps, that it had before there were some.
    episodes: Annotated[Integer, Field(ge=0, le=MAX_SEARCHED, exclude_if=lambda value: value == 0)] = 0


class SearchBudget(Spec):
    """What a search may cost.

    Attributes:
        episodes: How many may be simulated, those of the pilot among them.
    """

    episodes: Annotated[
        Integer, Within(MIN_SEARCHED, MAX_SEARCHED, "episodes, of which a pilot takes up to a quarter")
    ] = 20_000


class SearchEstimate(Spec):
    """How sharp the probability has to be.

    Attributes:
        relativeError: The search ends once the interval reaches so far from the probability, as a share of it; None
            spends the budget.
        confidence: Of the interval.
    """

    relativeError: Annotated[Number, Field(ge=0.01, le=1.0)] | None = None
    confidence: Annotated[Number, Field(ge=0.5, le=0.9999)] = 0.95


# What a search draws by a word: where robots begin and go to, and what varies by itself and may be named all the same.
_WORDS = {"start": ("anywhere",), "goals": ("scenario", "shares"), "worlds": ("all",)}
_SPELLED_OUT = {("start", "anywhere"): OF_START, ("goals", "shares"): OF_GOALS}


def _spelled_out(over: object) -> object:
    """Returns raw distributions with numbers in place of words that stand for some, and without what varies by itself.

    Other words are left out, too: `Search.findings` tells of them.
    """
    if not isinstance(over, Mapping):
        return over
    raw = cast("Mapping[str, object]", over)
    found = {name: each for name, each in raw.items() if not (name in _WORDS and isinstance(each, str))}
    for (word, value), names in _SPELLED_OUT.items():
        if raw.get(word) == value:
            found |= {name: {"uniform": [RANGES[name].least, RANGES[name].most]} for name in names if name not in raw}
    return found


class _OrWord:
    """Says in the JSON schema that a distribution may be a word: Prefect compares documents with it, words and all."""

    def __get_pydantic_json_schema__(self, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Returns the schema of distributions, or words, by name."""
        schema, words = handler(core_schema), {"enum": [each for values in _WORDS.values() for each in values]}
        either = {"if": {"type": "string"}, "then": words, "else": schema["additionalProperties"]}
        return {**schema, "additionalProperties": either}


class Search(Ruled):
    """A search for rare failures of the batch's robot, and how probable they are.

    Attributes:
        over: Environment variables of the batch's request, and physical parameters, each with its
            distribution; ``start: anywhere`` is three of these, ``goals: shares`` four. Worlds and seeds vary as well:
            each of the batch's worlds is as likely, and so is each seed, and ``worlds: all`` and ``goals: scenario``
            only say so.
        measure: A column that is below 0 in a failure, and near 0 close to one; an episode that did not pass is a
            failure whatever it says.
        against: Number of another version of the robot application: a failure is an episode in which that one passes.
        find: Which failures are reported.
        budget: What it may cost.
        estimate: How sharp the probability has to be.
        seed: Everything that is drawn follows from it.
    """

    over: Annotated[dict[str, Distribution], Field(max_length=20), BeforeValidator(_spelled_out), _OrWord()] = Field(
        title="Over"
    )
    measure: str = Field(default="min_clearance_m", title="Measure")
    against: DeploymentVersion | None = Field(default=None, title="Against")
    find: SearchFind = Field(default=SearchFind(), title="Failures")
    budget: SearchBudget = Field(default=SearchBudget(), title="Budget")
    estimate: SearchEstimate = Field(default=SearchEstimate(), title="Estimate")
    seed: Seed = Field(default=0, title="Seed")

    @property
    def episodes(self) -> int:
        """How many may be simulated, but for those that confirm failures."""
        return self.budget.episodes + self.find.episodes

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields a measure that is none, and what cannot be varied yet."""
        measure = part(data, "measure")
        if isinstance(measure, str) and measure not in MEASURES:
            yield Finding(("measure",), measure, f"one of {', '.join(MEASURES)}")
        for name in [*_WORDS, *OF_START, *OF_GOALS]:
            if (given := part(data, name)) is not None:
                words = _WORDS.get(name, ("{uniform: [...]}",))
                word = given if given in words else words[0]
                yield Finding((name,), given, f"below over, where all stands that varies: over: {{{name}: {word}}}")
        over = part(data, "over")
        for name in _names(over):
            if name in _WORDS and isinstance(part(over, name), str) and part(over, name) not in _WORDS[name]:
                yield Finding(("over", name), part(over, name), " or ".join(_WORDS[name]))
            elif "." in name and name not in PHYSICAL:
                yield Finding(("over", name), name, f"an environment variable, or one of {', '.join(PHYSICAL)}")
            elif name in PHYSICAL and not all(map(RANGES[name].has, _bounds(part(over, name)))):
                allowed = f"uniform, logUniform or normal with two bounds, each {RANGES[name]}"
                yield Finding(("over", name), part(over, name), allowed)


def _bounds(over: object) -> Sequence[object]:
    """Returns the bounds of a raw distribution of numbers; nothing for those that it does not have."""
    normal = part(over, "normal")
    return items(part(over, "uniform") or part(over, "logUniform")) or [part(normal, "atLeast"), part(normal, "atMost")]


def unsearchable(search: object, batch: object) -> Iterator[Finding]:
    """Yields what a raw section ``search`` asks for that the batch beside it does not have."""
    if search is None:
        return
    if batch is None:
        yield Finding(("search",), search, "simulationBatch beside it, whose request and worlds it searches")
        return
    requests = items(part(batch, "createSimulationJobRequests"))
    if len(requests) > 1:
        one = "one request in createSimulationJobRequests: which of several is to be searched is not said"
        yield Finding(("search",), f"a batch of {len(requests)} requests", one)
    if (robots := part(batch, "robots")) not in (None, 1):
        yield Finding(("search",), f"a batch of {robots} robots in each world", "one robot: a search moves one alone")
    known = sorted(_set_names(batch, requests))
    allowed = f"a variable that the batch's request or matrix sets: {', '.join(known) or 'there is none'}"
    over = part(search, "over")
    for name in _names(over):
        if name not in known and "." not in name and not isinstance(part(over, name), str):
            yield Finding(("search", "over", name), name, allowed)
    for name, people in no_such_people(_names(over), part(batch, "people")):
        yield Finding(("search", "over", name), name, people)


def _names(over: object) -> Sequence[str]:
    return [*cast("Mapping[str, object]", over)] if isinstance(over, Mapping) else ()


def _set_names(batch: object, requests: Sequence[object]) -> set[str]:
    """Returns the environment variables that the episodes of a raw batch have."""
    uses = [
        use
        for each in requests
        for kind in ("robotApplications", "simulationApplications")
        for use in items(part(each, kind))
    ]
    tables = [part(part(use, "launchConfig"), "environmentVariables") for use in uses]
    tables.append(part(part(batch, "matrix"), "environmentVariables"))
    return {str(name) for table in tables if isinstance(table, Mapping) for name in cast("Mapping[str, object]", table)}


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
