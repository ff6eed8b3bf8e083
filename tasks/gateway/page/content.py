"""What stands on a page: facts, tables, pictures and texts, all of them plain text that rendering escapes."""

from dataclasses import dataclass, field

GOOD = frozenset({"PASS", "Passed", "Completed", "Succeeded", "InSync", "Finished"})
BAD = frozenset({"FAIL", "Failed", "RunningFailed", "PartialFailed", "NoResponse", "TimedOut"})
GOING = frozenset(
    {
        *("Running", "InProgress", "Completing", "Preparing", "Restarting", "Deploying", "PendingNewDeployment"),
        *("Canceling", "TimingOut", "Terminating", "Pending"),
    }
)
OPEN = frozenset({"INCONCLUSIVE"})
_TONES = (("good", GOOD), ("bad", BAD), ("open", OPEN), ("going", GOING))


def tone_of(state: str) -> str:
    """Returns the name of the colour of a status or a verdict: ``good``, ``bad``, ``open``, ``going`` or ``none``."""
    return next((tone for tone, states in _TONES if state in states), "none")


_LONGEST_WORD = 32  # RobotAgentConnectionTimeout: has 28; a digest, 64


@dataclass(frozen=True)
class Cell:
    """A text, and how it is shown.

    Attributes:
        text: What it says.
        href: Where it leads, in the page; empty for nowhere.
        small: A second line, or empty.
        at_s: A time in seconds since 1970, shown in place of the text; None for none.
        is_state: Whether the text is a status or a verdict, which has a colour.
        is_number: Whether it stands at the right.
        is_code: Whether it is shown as code.
    """

    text: str = ""
    href: str = ""
    small: str = ""
    at_s: float | None = None
    is_state: bool = False
    is_number: bool = False
    is_code: bool = False

    @property
    def is_blank(self) -> bool:
        """Whether nothing is shown."""
        return not self.text and not self.small and self.at_s is None

    @property
    def is_words(self) -> bool:
        """Whether it is words, which are not broken anywhere, and no digest or address."""
        return all(len(word) <= _LONGEST_WORD for word in f"{self.text} {self.small}".split())


@dataclass(frozen=True)
class Steps:
    """The pages of a list: which one this is, and where those beside it are.

    Attributes:
        words: Such as ``51 to 100 of 1,240``.
        newer: Where the page before it is; empty for the first.
        older: Where the page after it is; empty for the last.
    """

    words: str
    newer: str = ""
    older: str = ""


@dataclass(frozen=True)
class Table:
    """Rows under a heading.

    Attributes:
        title: The heading.
        columns: The head of each column.
        rows: A cell for each column.
        empty: What is said where there is no row.
        href: Where all rows are, if these are only the first.
        steps: The pages, if there are several.
        note: A line above it, or empty.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    empty: str = "There is none."
    href: str = ""
    steps: Steps | None = None
    note: str = ""


@dataclass(frozen=True)
class Facts:
    """Names and what they are."""

    title: str
    rows: tuple[tuple[str, Cell], ...]


@dataclass(frozen=True)
class Picture:
    """A picture that the gateway itself answers.

    Attributes:
        src: Its address in the page.
        alt: What is seen on it.
        name: What stands below it.
        href: Where it leads; empty for nowhere.
        small: A second line below it, or empty.
    """

    src: str
    alt: str
    name: str = ""
    href: str = ""
    small: str = ""


@dataclass(frozen=True)
class Gallery:
    """Pictures under a heading, small ones beside one another or one alone."""

    title: str
    pictures: tuple[Picture, ...]
    is_wide: bool = False
    empty: str = "There is none."
    href: str = ""
    steps: Steps | None = None


@dataclass(frozen=True)
class Text:
    """A text with its own lines, such as a document."""

    title: str
    body: str


Block = Table | Facts | Gallery | Text


@dataclass(frozen=True)
class Page:
    """A page.

    Attributes:
        title: What it is of.
        kind: The kind of that, above the title.
        state: A status or a verdict beside the title; empty for none.
        sentence: What is said first; empty for nothing.
        trail: Names and addresses of the pages above it.
        links: Names and addresses that stand below the title.
        blocks: The rest.
        is_going: Whether what it shows is under way, so that it is loaded again by itself.
    """

    title: str
    kind: str = ""
    state: str = ""
    sentence: str = ""
    trail: tuple[tuple[str, str], ...] = ()
    links: tuple[tuple[str, str], ...] = ()
    blocks: tuple[Block, ...] = ()
    is_going: bool = False


@dataclass(frozen=True)
class Frame:
    """What surrounds every page.

    Attributes:
        here: The address of the page, without a query that pauses it.
        is_paused: Whether the reader has stopped the page from being loaded again.
        signed_in: The id of the key; empty where nobody signs in.
        now_s: The time, seconds since 1970.
        sections: Names and addresses of the lists.
    """

    here: str
    is_paused: bool
    signed_in: str
    now_s: float
    sections: tuple[tuple[str, str], ...] = field(default=())
