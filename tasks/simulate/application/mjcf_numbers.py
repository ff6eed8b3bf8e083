"""Bounds of the numbers in an MJCF: what no robot needs, and what would keep MuJoCo busy or take a machine's memory.

Only what is far from any robot is refused: the bounds keep the time until a file is refused, or compiled, near a
second.
"""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from tasks.simulate.application.mjcf_xml import Element, shown

# MuJoCo itself cuts at 1e10 (mjMAXVAL); people write such numbers where they mean no limit.
_LARGEST = 1e15
_SHORTEST_STEP_S = 1e-5
_MOST_RANGE_STEPS = 20_000
_MEMORY_BYTES = 1 << 30
_PIXELS_OF_A_VERTEX = 2_000
_MULTIPLES = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40, "P": 1 << 50, "E": 1 << 60}
_MEMORY = re.compile(r"(\d{1,19})([KMGTPE]?)", re.IGNORECASE)
# What C reads as a number and Python does not, or what is not finite.
_NO_NUMBER = re.compile(r"[+-]?(nan(\(\w*\))?|inf(inity)?|0x[0-9a-f]*\.?[0-9a-f]*(p[+-]?\d+)?)", re.IGNORECASE)
_NAMES = frozenset({"name", "class", "childclass", "prefix"})


class _Bound(NamedTuple):
    """The most that each number of an attribute may be, and their product.

    Attributes:
        each: Of a single one.
        product: Of all; None if nothing multiplies them.
    """

    each: float
    product: float | None = None


_ANY = "*"
_BOUNDS: Mapping[tuple[str, str], _Bound] = {
    **{("size", name): _Bound(100_000) for name in ("njmax", "nconmax", "nuserdata", "nkey")},
    ("size", "nstack"): _Bound(1e8),
    **{
        ("size", f"nuser_{name}"): _Bound(100)
        for name in ("actuator", "body", "cam", "geom", "jnt", "sensor", "site", "tendon")
    },
    **{
        ("option", name): _Bound(10_000)
        for name in ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations")
    },
    **{("option", name): _Bound(1_000) for name in ("sdf_iterations", "sdf_initpoints")},
    ("hfield", "nrow"): _Bound(2_000),
    ("hfield", "ncol"): _Bound(2_000),
    ("texture", "width"): _Bound(4_096),
    ("texture", "height"): _Bound(24_576),
    ("texture", "nchannel"): _Bound(4),
    ("texture", "gridsize"): _Bound(64),
    ("mesh", "params"): _Bound(1_000, 20_000),
    ("skin", "subgrid"): _Bound(20),
    ("numeric", "size"): _Bound(10_000),
    ("user", "dim"): _Bound(1_000),
    ("contact", "num"): _Bound(1_000),
    ("camera", "resolution"): _Bound(8_192),
    ("global", "offwidth"): _Bound(8_192),
    ("global", "offheight"): _Bound(8_192),
    ("quality", "shadowsize"): _Bound(16_384),
    ("quality", "offsamples"): _Bound(64),
    **{("quality", name): _Bound(1_024) for name in ("numslices", "numstacks", "numquads")},
    (_ANY, "nsample"): _Bound(1_000),
    (_ANY, "actdim"): _Bound(100),
}


def check_numbers(element: Element) -> None:
    """Refuses an element with a number that is none, or far beyond what any robot needs.

    Raises:
        MjcfRefused: It has one; says which attribute, and what is allowed.
    """
    for name, text in element.attributes.items():
        if name not in _NAMES:
            _check_attribute(element, name, text)
    if element.tag in {"option", "lengthrange"}:
        _check_step(element)
    if element.tag == "lengthrange":
        _check_range(element)


def numbers(element: Element, name: str) -> list[float]:
    """Returns the numbers of an attribute; none if it is not there.

    Raises:
        MjcfRefused: What stands there are no numbers.
    """
    try:
        return [float(part) for part in element.attributes.get(name, "").split()]
    except ValueError as exc:
        raise element.refusal(f"{name} {shown(element.attributes[name])}: must be numbers") from exc


def made_pixels(element: Element) -> float:
    """Returns how many pixels, heights or vertices MuJoCo makes for an element without a file; 0 for most."""
    size = {"texture": ("width", "height"), "hfield": ("nrow", "ncol"), "mesh": ("params",)}.get(element.tag, ())
    found = [abs(number) for name in size for number in numbers(element, name)]
    # MuJoCo takes about as long for a vertex's hull as for so many pixels.
    return math.prod(found) * (_PIXELS_OF_A_VERTEX if element.tag == "mesh" else 1) if found else 0.0


def _check_attribute(element: Element, name: str, text: str) -> None:
    for part in text.split():
        if _NO_NUMBER.fullmatch(part) or abs(_number(part)) > _LARGEST:
            raise element.refusal(f"{name} {shown(text)}: must be finite, and at most {_LARGEST:g}")
    bound = _BOUNDS.get((element.tag, name)) or _BOUNDS.get((_ANY, name))
    if bound is not None:
        _check_bound(element, name, bound)
    if (element.tag, name) == ("size", "memory"):
        _check_memory(element, text)


def _check_bound(element: Element, name: str, bound: _Bound) -> None:
    found = [abs(number) for number in numbers(element, name)]
    if any(number > bound.each for number in found):
        raise element.refusal(f"{name} {shown(element.attributes[name])}: must be at most {bound.each:,.0f}")
    if bound.product is not None and math.prod(max(number, 1.0) for number in found) > bound.product:
        raise element.refusal(
            f"{name} {shown(element.attributes[name])}: their product must be at most {bound.product:,.0f}"
        )


def _check_memory(element: Element, text: str) -> None:
    found = _MEMORY.fullmatch(text.strip())
    if text.strip() == "-1":  # MuJoCo's own choice
        return
    if found is None or int(found[1]) * _MULTIPLES[found[2].upper()] > _MEMORY_BYTES:
        raise element.refusal(f"memory {shown(text)}: must be at most 1G, such as 64M")


def _check_step(element: Element) -> None:
    if any(0.0 < step_s < _SHORTEST_STEP_S for step_s in numbers(element, "timestep")):
        given = shown(element.attributes["timestep"])
        raise element.refusal(f"timestep {given} s: must be at least {_SHORTEST_STEP_S:g}")


def _check_range(element: Element) -> None:
    step_s, total_s = (
        next(iter(numbers(element, name)), given) for name, given in (("timestep", 0.01), ("inttotal", 10))
    )
    if step_s > 0 and total_s / step_s > _MOST_RANGE_STEPS:
        raise element.refusal(f"inttotal of {total_s / step_s:,.0f} time steps: must be at most {_MOST_RANGE_STEPS:,}")


def _number(part: str) -> float:
    """Returns a number, or 0 for what is none."""
    try:
        found = float(part)
    except ValueError:
        return 0.0
    return found if math.isfinite(found) else math.inf
