"""The facts that a report takes from a batch's records, the gate's answer among them."""

from pydantic import Field

from specs.base import Spec
from specs.data.episode import ApplicationLaunch
from specs.data.parity_audit import AuditReport
from specs.data.run_report import Verdict
from specs.errors import ObjectNotFound
from tasks.results.gate.evidence import Evidence, read_evidence
from tasks.results.gate.shipped_builds import shipment_lines
from tasks.results.statistics.found_failures import BatchSearch
from tasks.results.statistics.intervals import Interval
from tasks.storage.base.store import Store


class RuleAnswer(Spec):
    """One of the gate's rules, and what it said."""

    name: str
    verdict: Verdict
    sentence: str


class Judgement(Spec):
    """What the gate answered.

    Attributes:
        at_least: The success rate that was asked for, 0-1, or None if none was.
        confidence: Coverage of the intervals that it was judged by.
        rate: The success rate that was judged, of the tested version alone; None if none was.
        interval: Its interval, or None likewise.
        method: What that is: ``Wilson``, or ``repeated confidence interval`` for a batch that may end early.
        over_worlds: Whether that interval is of worlds like these, and not of these alone.
        rules: Each rule by itself, where there are several.
        alone: The version that was judged, where the batch drove the one that it was compared with, too; else empty.
        digests: SHA-256 of each robot application that was judged, likewise; else none.
        ships: What the document ships, and what of it no episode drove, a line each.
    """

    verdict: Verdict
    sentence: str
    at_least: float | None
    confidence: float
    rate: float | None = None
    interval: Interval | None = None
    method: str = ""
    over_worlds: bool = False
    rules: tuple[RuleAnswer, ...] = ()
    alone: str = ""
    digests: tuple[str, ...] = ()
    ships: tuple[str, ...] = ()


class StageTime(Spec):
    """How long a stage of the run took, by the clock of who ran it."""

    name: str
    seconds: float
    summary: str


class Link(Spec):
    """A file beside the report.

    Attributes:
        href: Relative where the file lies beside the report, else where it lies.
        sha256: Its digest, or empty where the record has none.
    """

    label: str
    href: str
    sha256: str = ""


class BatchFacts(Spec):
    """What is known of a batch without reading a row.

    Attributes:
        batch: Its id.
        arn: Its ARN.
        store: The store's id, for the ARNs of jobs.
        name: What its document is called, or empty.
        status: RoboMaker's status.
        why: Why it failed or was stopped, or empty.
        created_at_s: Seconds since 1970, as recorded.
        simulated_s: Simulated seconds of all episodes.
        seeds: How many seeds it was run with.
        worlds: SHA-256 of each world's document, by ``<generation>/<name>``, in the batch's order.
        variables: The values that each environment variable takes; None where an episode does not set it.
        robots: Robot applications, each once.
        simulations: Simulation applications, each once.
        metadata: Engine, device, lanes and versions.
        judgement: The gate's answer, or None where nobody judged.
        audit: The parity audit as recorded, or None.
        search: What its document's search found, or None where there was none.
        looks: At how many looks its gate might have ended it; 0 where it was driven to its end.
        stages: How long the run's stages took, or nothing where that is not recorded.
        links: Files of the batch.
        trend: Link to the page of the document's nights, or empty where it is of no document's run.
        pictures: Whether its recordings keep what robots' cameras saw.
    """

    batch: str
    arn: str
    store: str
    name: str
    status: str
    why: str
    created_at_s: float
    simulated_s: float
    seeds: int
    worlds: dict[str, str]
    variables: dict[str, tuple[str | None, ...]]
    robots: tuple[ApplicationLaunch, ...]
    simulations: tuple[ApplicationLaunch, ...]
    metadata: dict[str, str]
    judgement: Judgement | None = None
    audit: AuditReport | None = None
    search: BatchSearch | None = None
    looks: int = 0
    stages: tuple[StageTime, ...] = ()
    links: tuple[Link, ...] = Field(default=())
    trend: str = ""
    pictures: bool = False


_CONFIDENCE = 0.95
_RATE = "successRate"


def read_judgement(store: Store, batch: str) -> Judgement | None:
    """Returns what the gate answered on a batch; None where it was not judged.

    Raises:
        ValidationError: What lies there is no evidence.
    """
    try:
        return judgement_of(read_evidence(store, batch))
    except ObjectNotFound:
        return None


def judgement_of(evidence: Evidence) -> Judgement:
    """Returns what evidence says of the gate's answer."""
    rate, rules = evidence.rule.successRate, evidence.rules
    judged = evidence.judged_robots()
    alone = () if judged == evidence.robots else judged
    answer = next((each for each in rules if each.rule == _RATE), None)
    return Judgement(
        verdict=evidence.verdict,
        sentence=evidence.sentence,
        at_least=rate.atLeast if rate else None,
        confidence=rate.confidence if rate else _CONFIDENCE,
        rate=answer.estimate if answer else None,
        interval=_interval(answer.lower, answer.upper) if answer else None,
        method=answer.method if answer else "",
        over_worlds=bool(rate and rate.over),
        rules=tuple(RuleAnswer(name=each.title, verdict=each.verdict, sentence=each.sentence) for each in rules),
        alone=", ".join(f"{robot.name} version {robot.version}" for robot in alone),
        digests=tuple(robot.digest for robot in alone),
        ships=tuple(shipment_lines(evidence.ships)) if evidence.ships else (),
    )


def _interval(lower: float | None, upper: float | None) -> Interval | None:
    return None if lower is None or upper is None else Interval(lower=lower, upper=upper)
