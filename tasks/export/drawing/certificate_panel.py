"""The certificate below the plan: what is guaranteed, in figures, and what became of every wish of the template."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from specs.data.world import Certificate, Wish, World
from tasks.export.drawing.plan_page import PageBox, element, fit_text, text_width

MAX_WISHES = 28
_VALUE_SIZE, _MEANING_SIZE, _HEADING_SIZE, _WISH_SIZE = 18.0, 10.5, 12.5, 11.0
_FACTS_HEIGHT, _HEADING_HEIGHT, _WISH_LINE, _GAP = 62.0, 26.0, 17.0, 28.0
_MARK_WIDTH, _SUBJECT_SHARE = 16.0, 0.37


def draw_certificate(parent: ET.Element, world: World, box: PageBox) -> None:
    """Adds the figures in one row, and below it the wishes in two columns, those not fulfilled first."""
    certificate = world.certificate
    group = element(parent, "g", class_="certificate")
    element(group, "title", "Certificate: measured on the finished geometry")
    element(group, "path", d=f"M{box.left:.2f} {box.top:.2f}H{box.right:.2f}", class_="rule")
    facts = _facts(world)
    column = box.width / len(facts)
    for number, (value, meaning) in enumerate(facts):
        x = box.left + number * column
        element(group, "text", value, x=x, y=box.top + 28, font_size=_VALUE_SIZE, class_="name")
        shown = fit_text(meaning, _MEANING_SIZE, column - 4)
        element(group, "text", shown, x=x, y=box.top + 44, font_size=_MEANING_SIZE, class_="quiet")
    if certificate.wishes:
        _wishes(group, certificate, PageBox(box.left, box.top + _FACTS_HEIGHT, box.right, box.bottom))


def certificate_height(certificate: Certificate) -> float:
    """Returns the page units that `draw_certificate` needs."""
    if not certificate.wishes:
        return _FACTS_HEIGHT
    return _FACTS_HEIGHT + _HEADING_HEIGHT + _rows(len(_shown(certificate))) * _WISH_LINE + 8.0


def wishes_met(certificate: Certificate) -> str:
    """Returns how many of the template's wishes the world fulfils, as a sentence without its end."""
    wishes = certificate.wishes
    met = sum(wish.met for wish in wishes)
    if not wishes:
        return "no wishes"
    return f"all {met} wishes fulfilled" if met == len(wishes) else f"{met} of {len(wishes)} wishes fulfilled"


def _facts(world: World) -> list[tuple[str, str]]:
    certificate = world.certificate
    as_set = (f"{certificate.doors_as_set_robot_radius_m:.2f} m", "doors as they stand")
    return [
        (f"{certificate.origin_clear_radius_m:.2f} m", "clear around start"),
        (f"{certificate.reachable_robot_radius_m:.2f} m", "largest robot radius"),
        *([as_set] if world.doors else []),
        (f"{certificate.narrowest_passage_m:.2f} m" if world.passages else "none", "narrowest passage"),
        (f"{100 * certificate.free_floor_share:.0f} %", "free floor"),
        (f"{100 * certificate.area_error_mean:.1f} %", "mean area error"),
        (f"{certificate.overlaps}", "overlaps"),
    ]


def _wishes(parent: ET.Element, certificate: Certificate, box: PageBox) -> None:
    heading = wishes_met(certificate)
    y = box.top + _HEADING_SIZE
    element(parent, "text", heading[0].upper() + heading[1:], x=box.left, y=y, font_size=_HEADING_SIZE, class_="name")
    lines = _shown(certificate)
    rows = _rows(len(lines))
    width = (box.width - _GAP) / 2
    for number, line in enumerate(lines):
        x = box.left + number // rows * (width + _GAP)
        y = box.top + _HEADING_HEIGHT + (number % rows) * _WISH_LINE + _WISH_SIZE
        if isinstance(line, str):
            element(parent, "text", line, x=x + _MARK_WIDTH, y=y, font_size=_WISH_SIZE, class_="quiet")
        else:
            _wish(parent, line, PageBox(x, y - _WISH_SIZE, x + width, y))


def _wish(parent: ET.Element, wish: Wish, box: PageBox) -> None:
    group = element(parent, "g", class_="wish met" if wish.met else "wish unmet")
    came = wish.found if wish.found == wish.wished else f"{wish.found} (wished {wish.wished})"
    came = came.replace(" m2", " m²")
    element(group, "title", f"{_name(wish)}{_kind(wish)}: {came}")
    mark = "l3 3.2l5.4 -7" if wish.met else "m0.6 -3.4l7 7m0 -7l-7 7"
    element(group, "path", d=f"M{box.left:.2f} {box.bottom - 4:.2f}{mark}", class_="mark")
    width = box.width - _MARK_WIDTH
    x = box.left + _MARK_WIDTH
    # What is cut is the name of a room, not what was wished of it.
    kind = _kind(wish)
    name = fit_text(_name(wish), _WISH_SIZE, _SUBJECT_SHARE * width - 6 - text_width(kind, _WISH_SIZE))
    element(group, "text", name + kind, x=x, y=box.bottom, font_size=_WISH_SIZE)
    shown = fit_text(came, _WISH_SIZE, (1 - _SUBJECT_SHARE) * width)
    element(group, "text", shown, x=x + _SUBJECT_SHARE * width, y=box.bottom, font_size=_WISH_SIZE, class_="quiet")


def _name(wish: Wish) -> str:
    return wish.kind.capitalize() if wish.kind == "footprint" else wish.subject


def _kind(wish: Wish) -> str:
    """Returns what was wished of the subject; a pair of rooms says enough of a connection."""
    return "" if wish.kind in ("footprint", "connection") else f", {wish.kind}"


def _shown(certificate: Certificate) -> Sequence[Wish | str]:
    """Returns the wishes, those not fulfilled first, and instead of the last ones how many more there are."""
    ordered = [
        *(wish for wish in certificate.wishes if not wish.met),
        *(wish for wish in certificate.wishes if wish.met),
    ]
    if len(ordered) <= MAX_WISHES:
        return ordered
    rest = ordered[MAX_WISHES - 1 :]
    unmet = sum(not wish.met for wish in rest)
    more = f"and {len(rest)} more" + (f", {unmet} of them not fulfilled" if unmet else ", fulfilled")
    return [*ordered[: MAX_WISHES - 1], more]


def _rows(count: int) -> int:
    return -(-count // 2)
