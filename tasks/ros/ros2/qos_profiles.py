"""Qualities of service as ROS 2 has them, in the form that rmw_cyclonedds gives to DDS.

Source: ROS 2's documentation, "Quality of Service settings"; defaults of rmw (rmw_qos_profile_*).
"""

from typing import NamedTuple

from cyclonedds.core import Policy, Qos
from cyclonedds.util import duration


class Profile(NamedTuple):
    """A profile of ROS 2.

    Attributes:
        depth: How many samples are kept.
        reliable: Lost samples are sent again.
        latched: Who comes late gets what was sent before (transient local).
    """

    depth: int = 10
    reliable: bool = True
    latched: bool = False


DEFAULT = Profile()
SENSOR_DATA = Profile(depth=5, reliable=False)
CLOCK = Profile(depth=1, reliable=False)
TRANSFORMS = Profile(depth=100)
STATIC_TRANSFORMS = Profile(depth=1, latched=True)
MAP = Profile(depth=1, latched=True)
SERVICES = Profile()
ENTITIES = Profile(depth=1, latched=True)


def dds_qos(profile: Profile, user_data: bytes) -> Qos:
    """Returns a profile as DDS has it; samples in XCDR1, which is all that ROS 2 writes.

    Args:
        profile: The profile.
        user_data: What the reader or writer says of itself.
    """
    forever, policies = duration(infinite=True), Policy.Durability
    own = [
        Policy.Reliability.Reliable(forever) if profile.reliable else Policy.Reliability.BestEffort,
        policies.TransientLocal if profile.latched else policies.Volatile,
        Policy.History.KeepLast(profile.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.Liveliness.Automatic(forever),
        Policy.Userdata(user_data),
    ]
    if profile.latched:
        kept = Policy.History.KeepLast(profile.depth)
        own.append(Policy.DurabilityService(0, kept, -1, -1, -1))
    return Qos(*own)
