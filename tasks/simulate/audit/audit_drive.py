"""The parity audit: drives a sample of a batch's episodes again, on their engine and on C MuJoCo, and compares.

C MuJoCo steps them in double precision among all solids. The engine that made the rows drives the sample again too:
that gives the ways to compare, and shows whether the rows are what it makes of their requests. Where they differ,
C MuJoCo drives the sample again from a micrometre beside: what it flips by itself is chaos, and no engine's error. Rows
that C MuJoCo made are made again and compared with nothing: that an engine agrees with itself says only that the rows
are its own.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from tasks.simulate.application.code import BundleCrash
from tasks.simulate.audit.audit_findings import Driven, DrivenEpisode, findings
from tasks.simulate.audit.audit_report import AuditReport
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.audit.audit_verdict import needs_control, with_verdict
from tasks.simulate.audit.drives import UNDISTURBED_M, Drives
from tasks.simulate.devices import device_kind
from tasks.simulate.engine.engines import REFERENCE

logger = logging.getLogger(__name__)
DISTURBANCES_M = ((1e-6, 0.0), (0.0, 1e-6))
"""Where the control starts, from where the episode does (x, y): far below what any map or sensor knows."""


def drive_sample(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    beside_m: tuple[float, float] = UNDISTURBED_M,
) -> dict[int, DrivenEpisode]:
    """Returns episodes driven to their ends, by index; without those that could not start.

    Args:
        requests: Any of a batch.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: Of a program.
        engine: ``auto``, or the engine that must drive them.
        beside_m: How far from its place each robot starts (x, y).

    Raises:
        BundleCrash: An application does not import, or raises when it is traced.
    """
    with Drives() as drives:
        return drives.begin(requests, worlds, bundles, lanes=lanes, engine=engine, beside_m=beside_m)()


def audit(
    sample: Sequence[SampledEpisode],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    drawn: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> AuditReport:
    """Returns what driving a sample again shows.

    Args:
        sample: At least one episode.
        worlds: At least those of the sample.
        bundles: Unpacked folders of the applications, by digest.
        lanes: Of a program. With those of the batch, the engine drives the sample in the batch's own programs, which
            are there already, or in one of a quarter of the lanes, which whoever recounts the batch takes, too; C
            MuJoCo drives it in one with no more lanes than there are episodes.
        engine: What the batch asked for.
        drawn: How many episodes were to be audited, if more than the sample: worlds may be gone.
        progress: Told how many of two drives for each episode are done, or will not be made.

    Raises:
        BundleCrash: An application that made rows before now fails.
    """
    here = [each for each in sample if each.row.device == device_kind()]
    others = [each.request for each in sample if each.row.engine != REFERENCE]
    few = min(lanes, len(sample))
    theirs: Driven = {}
    why = f"the rows were made by {REFERENCE}, the reference itself"
    with Drives() as drives:
        began_theirs: Callable[[], Driven] | None = None
        if others:  # first, because it takes longer
            try:
                began_theirs = drives.begin(others, worlds, bundles, lanes=few, engine=REFERENCE)
            except BundleCrash as crash:
                why = crash.reason
        ours = drives.begin([each.request for each in here], worlds, bundles, lanes=lanes, engine=engine)()
        progress(len(here))
        if began_theirs:
            theirs = began_theirs()
    progress(2 * len(sample))
    found = findings(sample, ours, theirs, (), max(drawn, len(sample)))
    if needs_control(found):
        again = [each for each in others if each.index in theirs]
        found = findings(sample, ours, theirs, _control(again, worlds, bundles, few), found.sampled)
    return with_verdict(found, why)


def _control(
    requests: Sequence[EpisodeRequest], worlds: Mapping[str, World], bundles: Mapping[str, Path], lanes: int
) -> list[Driven]:
    """Returns what C MuJoCo makes of episodes from a micrometre beside, in each direction; nothing if it cannot.

    All lanes are driven, and not only those that flipped: of these alone one could not tell a flip that is rare
    everywhere from one that is the engine's.
    """
    try:
        return [
            drive_sample(requests, worlds, bundles, lanes=lanes, engine=REFERENCE, beside_m=beside_m)
            for beside_m in DISTURBANCES_M
        ]
    except BundleCrash as crash:
        logger.warning("the audit has no control: %s", crash.reason)
        return []
