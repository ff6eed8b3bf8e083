"""The generation jobs that make a document's worlds: RoboMaker's job makes 50 at most, a document asks for more.

Each job makes a block of the document's floor plans and interiors, under their own numbers, so that a world is the same
whichever job makes it, and no two worlds of a document have one name.
"""

import hashlib
import re
from typing import NamedTuple

from pydantic import JsonValue

from specs.settings import MAX_WORLDS, ROBOMAKERS_MAX_WORLDS

MAX_WORLDS_OF_DOCUMENT = 10_000
_LONGEST_TOKEN = 64
_DIGEST_CHARACTERS = 16
_RUN_TOKEN = re.compile(r"run-[0-9a-f]{16}-")


class GenerationPart(NamedTuple):
    """The worlds that one job makes.

    Attributes:
        number: Of the job, from 1.
        first_floorplan: From 1.
        first_interior: From 1.
        floorplans: How many floor plans.
        interiors: How many interiors of each.
    """

    number: int
    first_floorplan: int
    first_interior: int
    floorplans: int
    interiors: int

    @property
    def first(self) -> tuple[int, int]:
        """Returns the floor plan and the interior of its first world."""
        return self.first_floorplan, self.first_interior

    def token(self, token: str) -> str:
        """Returns the client request token of the job, given that of the section: the first job has it as it is.

        A token of a document's own is followed by its digest: ``night-2`` may be another document's. It is cut where
        it leaves no room for that. A run's token is nobody else's, and is followed by the number alone.
        """
        if self.number == 1:
            return token
        end = f"-{self.number}"
        if not _RUN_TOKEN.match(token):
            digest = hashlib.sha256(token.encode()).hexdigest()[:_DIGEST_CHARACTERS]
            end = f"-{digest}{end}"
        return token[: _LONGEST_TOKEN - len(end)] + end


def generation_parts(floorplans: int, interiors: int, most: int | None = None) -> tuple[GenerationPart, ...]:
    """Returns the jobs that make so many worlds, in order; one where one job may make them all.

    Args:
        floorplans: Different floor plans, at least 1.
        interiors: Worlds of each, at least 1.
        most: Worlds of one job; what this machine allows, if left out.
    """
    most = most or MAX_WORLDS.value()
    interiors_each = min(interiors, most)
    plans_each = max(1, most // interiors) if interiors <= most else 1
    blocks = [
        (plan, interior, min(plans_each, floorplans - plan + 1), min(interiors_each, interiors - interior + 1))
        for plan in range(1, floorplans + 1, plans_each)
        for interior in range(1, interiors + 1, interiors_each)
    ]
    return tuple(GenerationPart(number, *block) for number, block in enumerate(blocks, start=1))


def generation_tokens(section: JsonValue, token: str, most: int | None = None) -> list[str]:
    """Returns the tokens of all jobs that a recorded section has begun or may begin, on whatever machine.

    Args:
        section: A worldGeneration section as a run's record has it.
        token: That of the first job.
        most: Worlds of one job, where the run has begun them; else what may be begun on whatever machine.
    """
    count = section.get("worldCount") if isinstance(section, dict) else None
    names = ("floorplanCount", "interiorCountPerFloorplan")
    found = [count.get(name) if isinstance(count, dict) else 1 for name in names]
    plans, interiors = (each if type(each) is int and each > 0 else 1 for each in found)
    most = most or min(ROBOMAKERS_MAX_WORLDS, MAX_WORLDS.value())
    return [part.token(token) for part in generation_parts(plans, interiors, most)]
