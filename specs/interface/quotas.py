"""Quotas of the calls that make something: how much there may be, from the environment.

RoboMaker's accounts had few of each (docs/reference/robomaker.md, section 9), as others owned the machines. Here what
is asked for waits in the owner's own queue: the defaults only stop a script that has run away.
"""

from typing import NamedTuple

from specs.settings import count_setting


class Quota(NamedTuple):
    """How many of one thing there may be.

    Attributes:
        what: What is counted.
        setting: The variable that says how many.
        default: How many, if it says nothing.
    """

    what: str
    setting: str
    default: int

    def most(self) -> int:
        """Returns how many there may be.

        Raises:
            DocumentError: The variable is no number.
        """
        return count_setting(self.setting, self.default, f"a number of {self.what}, at least 1")


GENERATION_JOBS = Quota("world generation jobs at a time", "SIMYARD_MAX_GENERATION_JOBS", 100)
EXPORT_JOBS = Quota("world export jobs at a time", "SIMYARD_MAX_EXPORT_JOBS", 100)
BATCHES = Quota("simulation job batches at a time", "SIMYARD_MAX_BATCHES", 100)
SIMULATION_JOBS = Quota("single simulation jobs at a time", "SIMYARD_MAX_SIMULATION_JOBS", 1000)
DEPLOYMENTS = Quota("deployment jobs at a time", "SIMYARD_MAX_DEPLOYMENTS", 100)
APPLICATIONS = Quota("applications of a kind", "SIMYARD_MAX_APPLICATIONS", 100)
TEMPLATES = Quota("world templates", "SIMYARD_MAX_TEMPLATES", 100)
FLEETS = Quota("fleets", "SIMYARD_MAX_FLEETS", 20)
ROBOTS = Quota("robots", "SIMYARD_MAX_ROBOTS", 1000)
FLEET_ROBOTS = Quota("robots of a fleet", "SIMYARD_MAX_FLEET_ROBOTS", 1000)
