"""What a rule of the gate is, what it judges by, and what it answers.

Each rule answers PASS when its whole interval is within the bar, FAIL when the whole interval is beyond it, and else
INCONCLUSIVE. What is not known speaks against whoever needs it: `tasks.results.gate.missing_data` says what a PASS and
a FAIL take it for.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.data.episode import CANCELED
from specs.data.parity_audit import AuditReport
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import Gate
from tasks.results.gate.version_pairs import PairCounts
from tasks.results.statistics.batch_summary import EpisodeCounts
from tasks.results.statistics.room_coverage import RoomCoverage

if TYPE_CHECKING:
    import pyarrow as pa

    from tasks.results.statistics.rare_failures import FailureProbability

Section = TypeVar("Section", bound=Spec)
ColumnValues = Mapping[str, Sequence[Any]]
WORLD = "world"
"""The column that says in which world an episode was."""


class RuleVerdict(Spec):
    """One rule's answer.

    Attributes:
        rule: Where it stands in the gate, such as ``successRate`` or ``quantiles[0]``.
        sentence: The answer and why, for a person.
        method: What the interval is: ``Wilson``, ``repeated confidence interval``, ``Tango``, ``order statistics``, or
            one over worlds.
        counted: Episodes, or pairs of them.
        estimate: The share, difference or quantile as it was seen; None of nothing.
        lower: Lower bound of the interval; None if it has none.
        upper: Upper bound; None likewise.
        facts: More numbers, by name.
    """

    rule: str
    verdict: Verdict
    sentence: str
    method: str = ""
    counted: int = 0
    estimate: float | None = None
    lower: float | None = None
    upper: float | None = None
    facts: dict[str, JsonValue] = Field(default_factory=dict[str, JsonValue])

    @property
    def title(self) -> str:
        """Returns what a person calls the rule: its name in the document, and of a quantile what it is of."""
        return f"quantile of {self.facts['column']}" if "column" in self.facts else self.rule


class Completeness(NamedTuple):
    """What of a batch is not there to be judged.

    Attributes:
        canceled: Episodes that somebody canceled.
        missing: Episodes that never got a result.
        left_out: Episodes that were not needed any more, because the gate was certain.
        looks: After how many episodes the gate was asked, the last being all of them, of a batch that may have been
            ended by what was counted, so that no ordinary interval holds; none of one that was driven to its end.
        paired: Whether both versions drove the same episodes at each look.
        inner: Whether an interval that is too narrow will do, to see whether the right one is worth its computation.
    """

    canceled: int = 0
    missing: int = 0
    left_out: int = 0
    looks: tuple[int, ...] = ()
    paired: bool = False
    inner: bool = False

    @property
    def sequential(self) -> bool:
        """Whether the batch may have been ended by what was counted."""
        return bool(self.looks)

    def look(self, counted: int) -> int:
        """Returns how many episodes there were at the look, those included that ought to have been counted.

        Args:
            counted: Episodes, or pairs, that were.
        """
        whole = counted + self.canceled + self.missing
        return next((look for look in self.looks if look >= whole), whole)

    def text(self) -> list[str]:
        """Returns what a sentence says of it."""
        said = [f"{self.canceled} canceled"] * bool(self.canceled)
        said += [f"{self.missing} without a result"] * bool(self.missing)
        return said + [f"{self.left_out} not needed any more"] * bool(self.left_out)


_COMPLETE = Completeness()


class Share(NamedTuple):
    """How many episodes show something.

    Attributes:
        shown: Episodes that show it.
        unknown: Episodes that might show it: a PASS takes them for the worst, a FAIL for the best.
        n: All episodes, these included.
    """

    shown: int = 0
    unknown: int = 0
    n: int = 0

    def plus(self, more: "Share") -> "Share":
        """Returns the share of the episodes of both."""
        return Share(self.shown + more.shown, self.unknown + more.unknown, self.n + more.n)


class WorldShare(NamedTuple):
    """How many episodes of one world show something.

    Attributes:
        ended: Of those that came to an end.
        whole: Of all, where canceled ones might show it.
    """

    ended: Share
    whole: Share


@dataclass(frozen=True)
class GateMaterial:
    """What a gate judges by.

    Attributes:
        counts: What the episodes came to; of the tested version alone, where another one is in the same batch.
        lacks: What of the batch is not there to be counted.
        rows: The columns that the gate's rules need, of the same episodes; None if no rule needs any.
        pairs: How the tested version compares with the other one; or why it cannot be said.
        audit: What the batch's record says of its parity audit; None if there was none.
        rooms: How much of its worlds the robots were in; None where nothing says that.
        shares: What rules that count episodes have counted, by the rule's name; the gate fills it in.
        world_shares: The same of each world that has episodes; the gate fills it in.
        worlds: What tells worlds apart, by ``<generation>/<world>``; those that it does not have go by their names.
        attempts: Of each earlier attempt, on other episodes of the same version and without a PASS, how often it passes
            wrongly by chance, 0-1.
        rare: How probable a failure is, where the document asks for a search; else None.
    """

    counts: EpisodeCounts
    lacks: Completeness = _COMPLETE
    rows: "pa.Table | None" = None
    pairs: PairCounts | str = "there is no other version to compare with"
    audit: AuditReport | None = None
    rooms: RoomCoverage | None = None
    shares: Mapping[str, Share] = field(default_factory=dict[str, Share])
    world_shares: Mapping[str, Sequence[WorldShare]] = field(default_factory=dict[str, Sequence[WorldShare]])
    worlds: Mapping[str, str] = field(default_factory=dict[str, str])
    attempts: tuple[float, ...] = ()
    rare: "FailureProbability | None" = None

    def rows_by_world(self, rows: "pa.Table") -> dict[str, list[int]]:
        """Returns the positions of each world's rows; none where the rows do not say which world it was."""
        found: dict[str, list[int]] = {}
        if WORLD in rows.column_names:
            for at, name in enumerate(rows.column(WORLD).to_pylist()):
                found.setdefault(self.worlds.get(name, name), []).append(at)
        return found

    def ended_rows(self) -> "pa.Table":
        """Returns the rows of the episodes that came to an end.

        Raises:
            ValueError: There are no rows.
        """
        import pyarrow.compute as pc  # noqa: PLC0415 - `simyard plan` asks for rules alone, without Arrow

        return self.every_row().filter(pc.field("status") != CANCELED)

    def every_row(self) -> "pa.Table":
        """Returns the rows of all episodes.

        Raises:
            ValueError: There are no rows.
        """
        if self.rows is None:
            raise ValueError("a rule looks at columns of the results, and there are none")
        return self.rows


@dataclass(frozen=True)
class PlannedEpisodes:
    """What a gate is going to judge a planned batch by.

    Attributes:
        episodes: Of the tested version.
        pairs: Episodes that the tested version and the other one drive both.
        audited: Episodes that are driven again on C MuJoCo.
        no_baseline: Why there is nothing to compare with, where that is certain beforehand; else empty.
        worlds: In how many worlds they are.
        looks: After how many episodes the gate is asked, where it may end the batch early; else empty.
        icc: How alike episodes of one world were in earlier batches, 0-1; None where nothing says that.
        searched: How many episodes a search may simulate; 0 without one.
    """

    episodes: int
    pairs: int
    audited: int
    no_baseline: str = ""
    worlds: int = 1
    looks: tuple[int, ...] = ()
    icc: float | None = None
    searched: int = 0

    @property
    def per_world(self) -> int:
        """Returns how many episodes there are in a world, rounded."""
        return round(self.episodes / self.worlds) if self.worlds else 0


def _no_columns(_: Spec) -> Sequence[str]:
    return ()


@dataclass(frozen=True)
class GateRule(Generic[Section]):
    """A rule of the gate: how it judges, what it looks at, and what `simyard plan` says of it.

    Attributes:
        name: Its field in the document's gate section. A field of several, such as ``quantiles``, is one rule each.
        judge: Answers it, given what the document asks for, the material, and where the rule stands in the gate.
        plan: Yields what `simyard plan` prints of it: the rule, and how many episodes it needs.
        columns: The columns of ``results.parquet`` that it looks at; none if the batch's counts are enough.
        count: Counts the episodes that it is about from the values of its columns, as `judge` finds them in the
            material's ``shares``. A rule that can be sure before the batch's end counts with it, or by the counts
            alone; its columns are fields of an episode's result then.
    """

    name: str
    judge: Callable[[Section, GateMaterial, str], RuleVerdict]
    plan: Callable[[Section, PlannedEpisodes], Iterator[str]]
    columns: Callable[[Section], Sequence[str]] = _no_columns
    count: Callable[[ColumnValues], Share] | None = None

    def asked(self, gate: Gate) -> list[tuple[str, Section]]:
        """Returns what the document asks of this rule, each with where it stands; nothing if it asks for nothing."""
        found = getattr(gate, self.name)
        if isinstance(found, tuple):
            return [(f"{self.name}[{number}]", section) for number, section in enumerate(found)]
        return [] if found is None else [(self.name, found)]
