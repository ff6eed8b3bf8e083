"""The report's section about the parity audit, made from what the batch's record says."""

from collections.abc import Mapping, Sequence
from typing import cast

from pydantic import JsonValue

from specs.base import Spec

_ALARMING = frozenset({"SUSPECT", "NOT RUN"})
_NAMED = 8
_DISTANCES = (("final", "Apart at the end"), ("way", "Apart where farthest"))
# Of audits of older versions, which had no strata.
_OLD_SHARES = (("spread", "Spread over the batch"), ("failed", "Failed ones"))
_DIRECTIONS = (
    ("false_passes", "False passes", "passes fail"),
    ("false_alarms", "False alarms", "failures pass"),
    ("missed_contacts", "Missed contacts", "episodes without a contact have one"),
)


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
    found += [(label, _flips(share)) for name, label in _OLD_SHARES if (share := _mapping(audit, name))]
    for name, label, what in _DIRECTIONS:
        share = _mapping(audit, name)
        found += [(label, _direction(share, what))] if share.get("lanes") else []
    found += (
        [("In the whole batch", _total(total))] if (total := _mapping(audit, "total")).get("rate") is not None else []
    )
    found += [("C MuJoCo against itself", _control(audit, control))] if (control := _mapping(audit, "control")) else []
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
    flips, others = (cast("Sequence[Mapping[str, JsonValue]]", audit.get(name) or ()) for name in ("flips", "others"))
    not_again, unlocked = (cast("Sequence[JsonValue]", audit.get(name) or ()) for name in ("unreproduced", "unlocked"))
    return [
        ("Came to another end", [_flip(each) for each in flips]),
        ("Ended otherwise, with the same success", [_flip(each) for each in others]),
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


def _flip(each: Mapping[str, JsonValue]) -> str:
    chaotic = " (C MuJoCo itself flips it)" if each.get("chaotic") else ""
    return f"job {each['index']}: {each['row']}, not {each['reference']}{chaotic}"


def _direction(share: Mapping[str, JsonValue], what: str) -> str:
    return f"{share['flips']} of {share['lanes']} {what} on C MuJoCo ({_rate(share)})"


def _total(total: Mapping[str, JsonValue]) -> str:
    return f"success is another one on C MuJoCo in {_rate(total)}"


def _control(audit: Mapping[str, JsonValue], control: Mapping[str, JsonValue]) -> str:
    """Returns what C MuJoCo, started a micrometre beside, differs from itself, and what of the flips that explains."""
    said = [f"two of its drives, a micrometre apart, differ in success in {_rate(control)}"]
    flips = cast("Sequence[Mapping[str, JsonValue]]", audit.get("flips") or ())
    if flips:
        chaotic = sum(bool(each.get("chaotic")) for each in flips)
        said.append(f"{chaotic} of {len(flips)} flips are of lanes that it flips itself")
    for name, label, _ in _DIRECTIONS:
        share = _mapping(audit, name)
        if share.get("flips") and share.get("chance") is not None:
            chance = cast("float", share["chance"])
            said.append(f"an engine as good as it has so many {label.lower()} in {100 * chance:.1f} % of such audits")
    return "; ".join(said)


def _rate(each: Mapping[str, JsonValue]) -> str:
    rate, lower, upper = (cast("float", each[name]) for name in ("rate", "lower", "upper"))
    return f"{100 * rate:.1f} %, 95 % interval {100 * lower:.1f} to {100 * upper:.1f} %"


def _metres(each: Mapping[str, JsonValue]) -> str:
    figures = [(name, cast("float", each.get(f"{name}_m"))) for name in ("median", "p90", "max")]
    return ", ".join(f"{name} {value:.2g} m" for name, value in figures if value is not None)  # pyright: ignore[reportUnnecessaryComparison] - JSON
