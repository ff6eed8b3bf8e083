"""A run's whole report as one document: what `simyard run --json` prints and what CI is told of it.

docs/guide/ci.md shows each field. `FORMAT` changes when a field changes its meaning or goes; new ones may come.
"""

from typing import Literal

from specs.base import Fault, Spec
from specs.data.run_report import StageName, StageReport, Verdict
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.intervals import Interval, IntervalFamily, in_worlds
from tasks.results.statistics.over_worlds import WorldsLikeThese

FORMAT = "simyard-run/1"
Answer = Literal["PASSED", "NOT PASSED", "INCONCLUSIVE", "FAILED", "REFUSED"]
GroupState = Literal["passed", "failed", "error", "skipped"]


class FailureExample(Spec):
    """An episode that did not pass.

    Attributes:
        job: Its ARN.
        reason: In a word or two.
        explanation: What happened, for a person, cut to its first words; may be empty.
        replay: The command that drives it again.
    """

    job: str
    seed: int
    reason: str
    explanation: str
    replay: str


class ReasonCount(Spec):
    """How often episodes did not pass for a reason."""

    reason: str
    episodes: int


class GroupReport(Spec):
    """Episodes of one world that differ in their seeds alone.

    Attributes:
        name: What they drove: applications, and what is not the same in the whole batch.
        state: ``passed``; ``failed``: below the gate's bar; ``error``: that, and code of an application failed;
            ``skipped``: all were canceled. After a PASS no group is failed, whatever its rate.
        note: Why the state is not what the rate seems to say; or empty.
        episodes: How many came to an end.
        crashed: How many of them ended Failed, because code failed.
        canceled: How many more were canceled.
        rate: Share of them that passed; None of none.
        interval: Of the rate in this world, by itself: Wilson's, or exact at all looks of a batch that may end early.
        together: The one that holds together with those of all other groups of the batch.
        simulated_s: Simulated seconds of all.
        reasons: Why episodes did not pass, most frequent first.
        examples: Some of these, each reason first once, the farthest from its goals first.
    """

    name: str
    state: GroupState
    note: str = ""
    episodes: int
    passed: int
    crashed: int
    canceled: int
    rate: float | None
    interval: Interval
    together: Interval
    simulated_s: float
    reasons: tuple[ReasonCount, ...] = ()
    examples: tuple[FailureExample, ...] = ()


class WorldReport(Spec):
    """The groups of one world.

    Attributes:
        world: ``<generation>/<world>``.
        label: Its name, without the generation if the batch has one alone, so that it is the same every night.
    """

    world: str
    label: str
    groups: tuple[GroupReport, ...]

    @property
    def episodes(self) -> int:
        """Returns how many episodes came to an end in this world."""
        return sum(group.episodes for group in self.groups)

    @property
    def passed(self) -> int:
        """Returns how many of them passed."""
        return sum(group.passed for group in self.groups)


class CountedBatch(Spec):
    """A batch in groups.

    Attributes:
        arn: Of the batch.
        rate: Share that passed in these worlds; None of no episodes.
        interval: Of the rate: Wilson's, or exact at all looks of a batch that may end early.
        confidence: Of the interval, of that of worlds like these, and of those of all groups together.
        intervals: How many groups have episodes, those that are left out, too.
        like_these: How much worlds differ, and the rate in worlds like these as far as anything is said of it.
        bar: The success rate that the gate asks for; None if it asks for none.
        worlds: With their groups, in the batch's order; at most so many groups as a page can hold.
        left_out: Groups more than that.
        left_out_failed: How many of these are not as they should be.
    """

    arn: str
    episodes: int
    passed: int
    canceled: int
    rate: float | None
    interval: Interval
    confidence: float
    intervals: int
    like_these: WorldsLikeThese
    bar: float | None
    worlds: tuple[WorldReport, ...]
    left_out: int = 0
    left_out_failed: int = 0

    def where(self) -> str:
        """Returns in which worlds the rate holds, in words."""
        return in_worlds(self.like_these.spread.worlds)

    def family(self) -> IntervalFamily:
        """Returns how many intervals of groups there are, and how sure all of them together are."""
        return IntervalFamily(size=self.intervals, confidence=self.confidence)


class GateReport(Spec):
    """What the gate answered.

    Attributes:
        sentence: Why; a line for each rule if there are several.
        rules: The answer of each rule.
    """

    verdict: Verdict
    sentence: str
    rules: tuple[RuleVerdict, ...]


class RunFailure(Spec):
    """Why a run has no end of its own.

    Attributes:
        stage: The section that failed, if that is known.
        code: RoboMaker's failure code, or the kind of error.
        arn: The job that failed, or empty.
        faults: Of a document that was refused.
    """

    stage: StageName | None = None
    code: str
    reason: str
    arn: str = ""
    faults: tuple[Fault, ...] = ()


class FullReport(Spec):
    """A run, whole.

    Attributes:
        format: Which fields there are.
        answer: PASSED; NOT PASSED and INCONCLUSIVE as the gate and the deployment came out; FAILED: a stage failed;
            REFUSED: the document did.
        exit_code: What `simyard run` ends with.
        document: The document's name.
        store: URL of the store.
        run: Id of the run; empty if none began or its id is not known.
        verdict: The gate's; None for a document without a gate, or one that did not come so far.
        shipped: Whether a deployment succeeded; None if none was asked for, or it did not come so far.
        stages: Those that ended, with their ARNs, wall seconds and the places of their files.
        gate: None as long as no gate has answered.
        batch: None as long as no batch has its tables.
        failure: Why the run failed or was refused; None for one that came to its end.
        problems: What of this report could not be found out, and why.
    """

    format: Literal["simyard-run/1"] = FORMAT
    answer: Answer
    exit_code: int
    document: str
    store: str
    run: str = ""
    verdict: Verdict | None = None
    shipped: bool | None = None
    stages: tuple[StageReport, ...] = ()
    gate: GateReport | None = None
    batch: CountedBatch | None = None
    failure: RunFailure | None = None
    problems: tuple[str, ...] = ()
