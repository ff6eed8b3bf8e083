"""The report of `simyard gc`: what can go, what waits, what stays, and why."""

from specs.base import Spec


class FindingRow(Spec):
    """Objects of one kind that go, or stay, for one reason.

    Attributes:
        kind: Such as ``bundles``.
        objects: How many.
        bytes: Of all of them.
        why: Such as ``that nothing names``.
    """

    kind: str
    objects: int
    bytes: int
    why: str


class UnreadRecord(Spec):
    """A record that cannot be read.

    Attributes:
        record: Its key.
        why: What is wrong with it.
        keeps: Kinds of objects that stay because it might name them.
    """

    record: str
    why: str
    keeps: tuple[str, ...]


class GcReport(Spec):
    """What can go, or went.

    Attributes:
        store: Its URL.
        removed: Whether it was removed, or only told.
        freed: What can go; what went, once it was removed.
        waiting: What nobody names and is too young yet.
        stayed: What was to go, and was used when its turn came.
        unread: Records that cannot be read.
        left_out: What was not looked at.
        cache: What of this machine's cache can go, or went.
    """

    store: str
    removed: bool
    freed: tuple[FindingRow, ...]
    waiting: tuple[FindingRow, ...]
    stayed: tuple[FindingRow, ...]
    unread: tuple[UnreadRecord, ...]
    left_out: tuple[str, ...]
    cache: tuple[FindingRow, ...]
