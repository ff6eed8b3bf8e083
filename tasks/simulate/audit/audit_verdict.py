"""The verdict of an audit: whether its numbers are alarming, and a sentence that says why."""

import math

from tasks.simulate.audit.audit_estimate import FlipShare
from tasks.simulate.audit.audit_report import AuditReport, AuditVerdict

# Flips are no surprise in chaotic contacts, so that one is no alarm. It is raised by flips that C MuJoCo does not show
# by itself, when chance would give so many less often than that: were the true rate within its limit, and were the
# engine one more C MuJoCo, disturbed.
FLIP_LIMIT, FAILED_FLIP_LIMIT = 0.01, 0.05
FEWEST_FLIPS = 2
CHANCE = 0.05
# Engines that agree are micrometres apart, where no contact amplifies them into another end.
APART_LIMIT_M = 0.05
# C MuJoCo's own drives, a micrometre apart at first, stay so near where nothing amplifies: a thousand times that.
CALM_M = 1e-3
PARTED_LIMIT = 0.1


def with_verdict(found: AuditReport, why_not_compared: str = "") -> AuditReport:
    """Returns a report with its verdict, and a sentence that says why.

    Args:
        found: The numbers.
        why_not_compared: Why there are none of the reference, if so.
    """
    alarms = _alarms(found)
    said = [f"{found.lanes} of {found.lanes} rows were the same when driven again"] if not found.unreproduced else []
    if found.compared:
        said = _compared(found)
    elif not found.unreproduced:
        said.append(f"not compared: {why_not_compared}" if why_not_compared else "not compared")
    drawn = max(found.sampled, found.lanes)
    enough = found.compared > 0 and 2 * found.compared >= drawn
    if found.compared and not enough:
        said.append(f"no more than {found.compared} of the {drawn} drawn could be compared")
    verdict: AuditVerdict = "SUSPECT" if alarms else "SOUND" if enough else "NOT COMPARED"
    sentence = "; ".join(part for part in (*alarms, *_warnings(found), *said) if part)
    return found.model_copy(update={"verdict": verdict, "sentence": sentence})


def needs_control(found: AuditReport) -> bool:
    """Returns whether there is anything that chaos might explain: a flip, a contact, robots that part."""
    return bool(found.flips) or found.missed_contacts.flips > 0 or _apart_m(found) > APART_LIMIT_M


def exceeds(share: FlipShare, limit: float) -> bool:
    """Returns whether so many flips that are not chaotic are hardly to be had by chance at a true rate within a limit.

    Args:
        share: The flips.
        limit: The rate, 0-1.
    """
    n, flips = share.lanes, share.unexplained
    fewer = sum(math.comb(n, k) * limit**k * (1.0 - limit) ** (n - k) for k in range(flips))
    return flips >= FEWEST_FLIPS and 1.0 - fewer < CHANCE


def _alarmed(share: FlipShare, limit: float) -> bool:
    return exceeds(share, limit) and (share.chance is None or share.chance < CHANCE)


def _alarms(found: AuditReport) -> list[str]:
    alarms: list[str] = []
    if found.unreproduced:
        alarms.append(
            f"{len(found.unreproduced)} of {found.lanes} rows are not what their engine makes of them "
            f"({_few(found.unreproduced)})"
        )
    if _alarmed(found.false_passes, FLIP_LIMIT):
        alarms.append("episodes pass that fail on C MuJoCo, more often than a micrometre explains")
    if _alarmed(found.false_alarms, FAILED_FLIP_LIMIT):
        alarms.append("episodes fail that pass on C MuJoCo, more often than a micrometre explains")
    if _alarmed(found.missed_contacts, FLIP_LIMIT):
        alarms.append("robots touch nothing that touch something on C MuJoCo, more often than a micrometre explains")
    alarms += _parted(found)
    return alarms


def _parted(found: AuditReport) -> list[str]:
    """Returns the alarm that robots part which C MuJoCo keeps together; without a control, that they part."""
    control = found.control
    if control is None:
        said = f"robots with the same outcome are apart from C MuJoCo's by {_apart_m(found):.2g} m (p90)"
        return [said] * (_apart_m(found) > APART_LIMIT_M)
    said = f"robots in {control.parted} of {control.calm} lanes with the same outcome are more than {APART_LIMIT_M} m "
    said += "apart from C MuJoCo's, which stay together when they start a micrometre beside"
    return [said] * (control.parted >= max(FEWEST_FLIPS, PARTED_LIMIT * control.calm))


def _apart_m(found: AuditReport) -> float:
    return found.unflipped.p90_m if found.unflipped else 0.0


def _compared(found: AuditReport) -> list[str]:
    """Returns what a comparison came to: flips by direction, what C MuJoCo flips itself, how far robots are apart."""
    passes, failures = found.false_passes, found.false_alarms
    said = [f"{passes.text()} passes fail there ({_bounds(passes)})"] if passes.lanes else []
    said += [f"{failures.text()} failures pass there ({_bounds(failures)})"] if failures.lanes else []
    text = f"{found.compared} lanes on C MuJoCo: {', '.join(said)}" if said else f"{found.compared} lanes on C MuJoCo"
    parts = [text]
    if found.flips and found.control:
        chaotic = sum(bool(flip.chaotic) for flip in found.flips)
        lanes = "a lane" if chaotic == 1 else "lanes"
        verb = "is" if chaotic == 1 else "are"
        parts.append(f"{chaotic} of {len(found.flips)} flips {verb} of {lanes} that C MuJoCo itself flips")
    if found.way:
        parts.append(f"p90 {found.way.p90_m:.1g} m apart")
    return parts


def _bounds(share: FlipShare) -> str:
    return f"{100 * share.lower:.1f} to {100 * share.upper:.1f} %"


def _warnings(found: AuditReport) -> list[str]:
    """Returns what a person should know of rows that are the same: luck may have had a part in it."""
    if not found.unlocked:
        return []
    unlocked = f"lock-step did not hold in {len(found.unlocked)} of {found.ros} episodes ({_few(found.unlocked)})"
    return [f"{unlocked}: they may differ another time"]


def _few(indices: tuple[int, ...]) -> str:
    return ", ".join(map(str, indices[:5]))
