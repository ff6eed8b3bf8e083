"""A night: one batch of a document that ended, as a trend counts it."""

from specs.base import Spec
from specs.data.episode import ApplicationLaunch
from tasks.results.tables.history_rows import Cell

DEFAULT_MEASURE = "success"


class Night(Spec):
    """One batch of a document that ended.

    Attributes:
        run: Id of the document's run.
        request: Digest of all that decides what its batch drives: with the same one, the same episodes are driven.
        worlds_made: What decides the worlds that the run itself generates, as a digest.
        generation: The generation that these lie in; empty if the run makes none.
        batch: The batch's id; empty where the run has none.
        arn: Its ARN.
        begun_at_s: Seconds since 1970.
        robots: The robot applications that were tested, each once.
        variables: Names of the environment variables that have several values.
        cells: Its episodes; nothing if the night is left out.
        left_out: Why it does not count, or empty.
        vouched: Whether this machine's key vouches for its results.
        early: Whether it ended early, its gate being certain.
        more_generations: The others, where several jobs made them.
        page: Where its report lies, as seen from the trend's page; empty if there is none.
    """

    run: str
    request: str
    worlds_made: str
    generation: str
    batch: str
    arn: str
    begun_at_s: float
    robots: tuple[ApplicationLaunch, ...] = ()
    variables: tuple[str, ...] = ()
    cells: tuple[Cell, ...] = ()
    left_out: str = ""
    vouched: bool = False
    early: bool = False
    more_generations: tuple[str, ...] = ()
    page: str = ""

    def generations(self) -> tuple[str, ...]:
        """Returns the generations that the run's own worlds lie in."""
        return (self.generation, *self.more_generations)

    def bundle_names(self) -> str:
        """Returns the versions that were tested, with the beginning of each one's digest."""
        return ", ".join(f"{each.name} {each.version} ({each.digest[:12]})" for each in self.robots)

    def bundles(self) -> frozenset[str]:
        """Returns the digests of the robot applications that were tested."""
        return frozenset(each.digest for each in self.robots)
