"""The section of a pipeline that decides: what a batch must show before anything is deployed."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from specs.base import Fault, Spec
from specs.data.result_columns import MEASURES, MEASURES_OF_MOVERS
from specs.field_types import Boolean, Number
from specs.robomaker.deployment import DeploymentVersion
from specs.ros_robot import NAVIGATION_METRICS
from specs.rules import Finding, Location, Ruled, broken, items, meant, nearest_name, part

MAX_QUANTILES = 20
FEWEST_WORLDS = 2
"""How many worlds say anything of worlds like them."""
_STOP_EARLY = "stopEarly"
_NOT_EARLY = "no over beside stopEarly: an interval over worlds holds for a batch that runs to its end"
_SEQUENTIAL = "counts episodes one by one, so that it can be sure before the batch's end"
_METRIC = re.compile(r"metrics\..+")


def _column(name: str) -> str:
    if name in MEASURES or _METRIC.fullmatch(name):
        return name
    raise broken(
        f"{meant(name, MEASURES)}one of {', '.join(MEASURES)}, or metrics.<name> for what the scenario measures"
    )


Confidence = Annotated[Number, Field(ge=0.5, le=0.9999)]
# No number of episodes shows a rate of exactly 0 or 1: its interval always reaches beyond.
Bar = Annotated[Number, Field(gt=0, lt=1)]
# None, not a word for it: documents without it keep the digest that they had before there was such a field.
Over = Literal["worlds"] | None
_OVER = Field(
    default=None,
    title="Over",
    description="worlds: the answer is about worlds like these. Else it is about these worlds, with other seeds.",
)


class SuccessRate(Spec):
    """The share of episodes that must pass, and how sure that must be.

    Attributes:
        confidence: How sure it must be.
    """

    atLeast: Annotated[Number, Field(ge=0, lt=1)] = Field(title="At least", description="Such as 0.99.")
    confidence: Confidence = Field(default=0.95, title="Confidence")
    over: Over = _OVER


class NoWorseThan(Spec):
    """Another version of the tested application, and by how much this one may fall behind it.

    Attributes:
        confidence: How sure it must be.
    """

    applicationVersion: DeploymentVersion = Field(title="Version", description='A number such as "3".')
    margin: Annotated[Number, Field(ge=0, lt=1)] = Field(
        title="Margin", description="How much lower the success rate may be: 0.02 is two percentage points."
    )
    confidence: Confidence = Field(default=0.95, title="Confidence")
    over: Over = _OVER


class CollisionRate(Spec):
    """The share of episodes in which the robot may touch anything.

    Attributes:
        confidence: How sure it must be.
    """

    atMost: Bar = Field(title="At most", description="Such as 0.05.")
    confidence: Confidence = Field(default=0.95, title="Confidence")
    over: Over = _OVER


class FlipRate(Spec):
    """The share of episodes whose outcome may be another on C MuJoCo, by the parity audit.

    Attributes:
        confidence: How sure it must be.
    """

    atMost: Bar = Field(title="At most", description="Such as 0.05.")
    confidence: Confidence = Field(default=0.95, title="Confidence")


class FailureBar(Spec):
    """How probable a failure may be where the variables are distributed as the document's search says.

    Attributes:
        confidence: How sure it must be: as sure as the search's interval is.
    """

    atMost: Bar = Field(title="At most", description="Such as 0.001.")
    confidence: Confidence = Field(default=0.95, title="Confidence")
    announced: bool = Field(
        default=False,
        title="Announced failures alone",
        description="Presume that the measure or what varies tells of all ways to fail, and judge the interval alone.",
    )


class QuantileRule(Ruled):
    """Where a quantile of a column of the results must lie.

    Attributes:
        atLeast: The quantile's lowest value, in the column's unit; either this or the highest.
        atMost: Its highest value.
        confidence: How sure it must be.
    """

    column: Annotated[str, AfterValidator(_column)] = Field(title="Column", description="Such as min_clearance_m.")
    quantile: Bar = Field(title="Quantile", description="0.05 is the value that 5 % of the episodes are below.")
    atLeast: Number | None = Field(default=None, title="At least")
    atMost: Number | None = Field(default=None, title="At most")
    confidence: Confidence = Field(default=0.95, title="Confidence")
    over: Over = _OVER
    failed: Literal["worst"] | None = Field(
        default=None,
        title="Failed",
        description="worst: an episode that did not pass has the worst value. Else it has what was measured, and that "
        "is not held in its favour where it ended early.",
    )

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields a bar that is missing, or one too many."""
        bars = [name for name in ("atLeast", "atMost") if part(data, name) is not None]
        if len(bars) != 1:
            yield Finding((), ", ".join(bars) or "neither", "one of atLeast and atMost")


class Gate(Ruled):
    """What the batch must show before anything is deployed: all of its rules.

    Attributes:
        successRate: Share of episodes that must pass.
        noWorseThan: Another version that this one may hardly fall behind.
        collisionRate: Share of episodes in which the robot may touch anything.
        maxOutcomeFlipRate: Share of episodes that may end otherwise on C MuJoCo; needs the parity audit.
        quantiles: Bounds for quantiles of measures, at most 20.
        failureProbability: How probable a failure may be; needs the section search.
    """

    successRate: Annotated[SuccessRate | None, _SEQUENTIAL] = Field(default=None, title="Success rate")
    noWorseThan: Annotated[NoWorseThan | None, _SEQUENTIAL] = Field(default=None, title="No worse than another version")
    collisionRate: Annotated[CollisionRate | None, _SEQUENTIAL] = Field(default=None, title="Collision rate")
    maxOutcomeFlipRate: FlipRate | None = Field(default=None, title="Outcomes that differ from C MuJoCo's")
    quantiles: Annotated[tuple[QuantileRule, ...], Field(max_length=MAX_QUANTILES)] | None = Field(
        default=None, title="Quantiles"
    )
    failureProbability: FailureBar | None = Field(default=None, title="Probability of a failure")
    # None, not False: documents without it keep the digest that they had before there was such a field.
    stopEarly: Boolean | None = Field(
        default=None,
        title="Stop early",
        description="Ends the batch when its rates, and its comparison with a version that it drives too, are certain.",
    )

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields a gate without rules, a batch that nothing could stop, and quantiles that are asked for twice."""
        asked = [name for name in RULES if part(data, name) not in (None, [], ())]
        if not asked:
            yield Finding((), data, f"at least one of {', '.join(RULES)}")
        if part(data, _STOP_EARLY) is True and not set(asked) & set(SEQUENTIAL_RULES):
            allowed = f"{' or '.join(SEQUENTIAL_RULES)} beside it, which can be sure early"
            yield Finding((_STOP_EARLY,), part(data, _STOP_EARLY), allowed)
        if part(data, _STOP_EARLY) is True:
            yield from (Finding(loc, "worlds", _NOT_EARLY) for loc in _over_worlds(data))
        yield from _asked_twice(items(part(data, "quantiles")))


RULES = tuple(name for name in Gate.model_fields if name != _STOP_EARLY)
"""The gate's rules, in the order of the document."""
SEQUENTIAL_RULES = tuple(name for name in RULES if _SEQUENTIAL in Gate.model_fields[name].metadata)
"""Those that count episodes one by one, so that they can be sure before the batch's end."""


def stops_early(gate: Gate | None) -> bool:
    """Returns whether the gate may end its batch before the last episode."""
    return gate is not None and bool(gate.stopEarly)


def unaudited(gate: object, audit: object) -> Iterator[Finding]:
    """Yields the rule about the parity audit in a raw document whose batch makes none."""
    lanes: Any = part(audit, "lanes")
    if part(gate, "maxOutcomeFlipRate") is not None and lanes == 0 and type(lanes) is int:
        allowed = "simulationBatch.audit.lanes above 0, for the episodes that it counts"
        yield Finding(("gate", "maxOutcomeFlipRate"), "audit.lanes is 0", allowed)


def unsearched(gate: object, search: object) -> Iterator[Finding]:
    """Yields the rule about rare failures in a raw document without a search, or with one of another confidence."""
    rule = part(gate, "failureProbability")
    if rule is None:
        return
    if search is None:
        yield Finding(("gate", "failureProbability"), rule, "a section search beside it, whose interval it judges")
        return
    asked, given = (
        0.95 if each is None else each
        for each in (part(rule, "confidence"), part(part(search, "estimate"), "confidence"))
    )
    if asked != given:
        allowed = f"search.estimate.confidence, which is {given}: the rule judges that interval"
        yield Finding(("gate", "failureProbability", "confidence"), asked, allowed)


def drawn_once(
    gate: object, batch: object, generation: object, *, imported: Mapping[str, Sequence[str]]
) -> Iterator[Finding]:
    """Yields rules about worlds like these in a raw document whose batch certainly has one world alone.

    Args:
        gate: The gate's section.
        batch: The batch's.
        generation: That of the worlds that are generated.
        imported: The names of the worlds that each entry of the section ``worlds`` makes, by its name.
    """
    if _worlds_at_most(batch, generation, imported) == 1:
        allowed = f"{FEWEST_WORLDS} worlds or more in the batch; one world says nothing of others"
        yield from (Finding(("gate", *loc), "worlds", allowed) for loc in _over_worlds(gate))


def _over_worlds(gate: object) -> Iterator[Location]:
    """Yields where rules ask about worlds like these."""
    sections: list[tuple[Location, object]] = [((name,), part(gate, name)) for name in RULES if name != "quantiles"]
    sections += [(("quantiles", number), each) for number, each in enumerate(items(part(gate, "quantiles")))]
    yield from ((*loc, "over") for loc, section in sections if part(section, "over") == "worlds")


def _worlds_at_most(batch: object, generation: object, imported: Mapping[str, Sequence[str]]) -> int | None:
    """Returns how many worlds a raw batch has at most; None where the document alone does not say it."""
    requests = items(part(batch, "createSimulationJobRequests"))
    if any(part(use, "worldConfigs") for each in requests for use in items(part(each, "simulationApplications"))):
        return None
    named, count = part(part(batch, "matrix"), "worlds"), part(generation, "worldCount")
    if named not in (None, "all"):
        return len({one for each in items(named) for one in imported.get(str(each), [str(each)])})
    sides: list[Any] = [part(count, name) for name in ("floorplanCount", "interiorCountPerFloorplan")]
    plans, interiors = (1 if each is None else each for each in sides)
    brought = sum(map(len, imported.values()))
    if generation is None:
        return brought or None
    return plans * interiors + brought if type(plans) is int and type(interiors) is int else None


def never_met(gate: object, batch: object) -> Iterator[Finding]:
    """Yields a finding for each quantile of how the robot meets people or robots in a batch in which there are none.

    Args:
        gate: The raw section.
        batch: Likewise.
    """
    alone = {"people": part(batch, "people") is None, "robots": part(batch, "robots") in (None, 1)}
    for number, rule in enumerate(items(part(gate, "quantiles"))):
        column = part(rule, "column")
        for movers in [each for each, measures in MEASURES_OF_MOVERS.items() if alone[each] and column in measures]:
            allowed = (
                f"a column that a batch without {movers} has; simulationBatch.{movers} puts {movers} into its worlds"
            )
            yield Finding(("gate", "quantiles", number, "column"), column, allowed)


def _asked_twice(quantiles: object) -> Iterator[Finding]:
    seen: set[tuple[str, str, bool]] = set()
    for number, rule in enumerate(items(quantiles)):
        key = (str(part(rule, "column")), str(part(rule, "quantile")), part(rule, "atLeast") is None)
        if key in seen:
            allowed = "each quantile of a column once from below and once from above"
            yield Finding(("quantiles", number), f"{key[1]} of {key[0]}", allowed)
        seen.add(key)


METRIC_PREFIX = "metrics."
"""What stands before a metric's name in a rule."""


def metric_faults(gate: Gate, known: Sequence[str]) -> list[Fault]:
    """Returns a fault for each rule about a metric that is not among those that are known, and none of navigation."""
    return [
        Fault(
            path=f"gate.quantiles[{number}].column",
            value=json.dumps(asked.column),
            allowed=metric_rule(asked.column.removeprefix(METRIC_PREFIX), known),
        )
        for number, asked in enumerate(gate.quantiles or ())
        if asked.column.startswith(METRIC_PREFIX)
        and asked.column.removeprefix(METRIC_PREFIX) not in {*known, *NAVIGATION_METRICS}
    ]


def metric_rule(name: str, known: Sequence[str]) -> str:
    """Returns which metrics a rule may ask for, the one that was probably meant first."""
    close = name if name in MEASURES else f"{METRIC_PREFIX}{near}" if (near := nearest_name(name, known)) else ""
    hint = f'did you mean "{close}"? ' if close else ""
    if not known:
        return f"{hint}one of {', '.join(MEASURES)}; the scenario measures nothing by itself"
    return f"{hint}the scenario measures {', '.join(f'{METRIC_PREFIX}{each}' for each in known)}"
