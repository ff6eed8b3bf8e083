"""Which engines a batch's robots ran on, for its records."""

from collections.abc import Mapping
from pathlib import Path

from tasks.simulate.batch_plan import BatchPlan
from tasks.simulate.devices import device_kind
from tasks.simulate.engines import choose_engine
from tasks.simulate.robot import RobotRefused


def engines_used(plan: BatchPlan, bundles: Mapping[str, Path]) -> str:
    """Returns the engines by name, comma-separated where robots differ, such as ``planar``; ``none`` ran nothing.

    Args:
        plan: The batch; its robots are asked again, and an engine follows from a robot's files and the device alone.
        bundles: Folder of each application's files, by digest.
    """
    found: set[str] = set()
    for launch in dict.fromkeys(template.robot for template in plan.templates):
        folder = bundles[launch.digest]
        module = folder / launch.package / f"{launch.launch_file}.py"
        try:
            found.add(choose_engine(plan.engine, folder / "robot.xml", module, device_kind()).engine)
        except RobotRefused:
            continue  # its episodes are rows that say why
    return ", ".join(sorted(found)) or "none"
