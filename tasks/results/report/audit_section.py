"""The report's section about the parity audit, made from what the batch's record says."""

from collections.abc import Mapping, Sequence
from typing import cast

from pydantic import JsonValue

from specs.base import Spec

_ALARMING = frozenset({"SUSPECT", "NOT RUN"})
_NAMED = 8
_DISTANCES = (("final", "Apart at the end"), ("way", "Apart where farthest"))
_SHARES = (("spread", "Spread over the batch"), ("failed", "Failed ones"))


class AuditLine(Spec):
    """One of the audit's figures."""

    label: str
    text: str


class AuditView(Spec):
    """The audit's verdict, its sentence, its figures.

    Attributes:
        alarming: Whether it has to be read before the numbers are.
    """

    verdict: str
    sentence: str
    alarming: bool
    lines: tuple[AuditLine, ...]


def audit_view(audit: Mapping[str, JsonValue]) -> AuditView:
    """Returns what a report shows of an audit; figures that are not there are left out.

    Args:
        audit: As it is recorded; docs/guide/audit.md says what its fields are.
    """
    found: list[tuple[str, str]] = []
    if "compared" in audit:
        found.append(
            ("Compared", f"{audit['compared']} episodes of {audit.get('engine')} with {audit.get('reference')}")
        )
    found += [(label, _flips(share)) for name, label in _SHARES if (share := _mapping(audit, name))]
    found += [(label, _metres(each)) for name, label in _DISTANCES if (each := _mapping(audit, name))]
    found += [(label, _listing(texts)) for label, texts in _episodes(audit) if texts]
    return AuditView(
        verdict=str(audit.get("verdict", "")),
        sentence=str(audit.get("sentence", "")),
        alarming=audit.get("verdict") in _ALARMING,
        lines=tuple(AuditLine(label=label, text=text) for label, text in found),
    )


def _episodes(audit: Mapping[str, JsonValue]) -> list[tuple[str, list[str]]]:
    """Returns the episodes that the audit names, with what it names them for."""
    flips = cast("Sequence[Mapping[str, JsonValue]]", audit.get("flips") or ())
    not_again, unlocked = (cast("Sequence[JsonValue]", audit.get(name) or ()) for name in ("unreproduced", "unlocked"))
    return [
        ("Came to another end", [f"job {each['index']}: {each['row']}, not {each['reference']}" for each in flips]),
        ("Could not be made again", [f"job {index}" for index in not_again]),
        ("Lock-step did not hold", [f"job {index}" for index in unlocked]),
    ]


def _listing(texts: Sequence[str]) -> str:
    more = f", and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return "; ".join(texts[:_NAMED]) + more


def _mapping(audit: Mapping[str, JsonValue], name: str) -> Mapping[str, JsonValue]:
    found = audit.get(name)
    return found if isinstance(found, dict) else {}


def _flips(share: Mapping[str, JsonValue]) -> str:
    return f"{share.get('flips')} of {share.get('lanes')} came to another end"


def _metres(each: Mapping[str, JsonValue]) -> str:
    figures = [(name, cast("float", each.get(f"{name}_m"))) for name in ("median", "p90", "max")]
    return ", ".join(f"{name} {value:.2g} m" for name, value in figures if value is not None)  # pyright: ignore[reportUnnecessaryComparison] - JSON
