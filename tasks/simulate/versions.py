"""What a batch's numbers depend on besides its documents."""

from importlib.metadata import version

_PACKAGES = ("simyard", "mujoco", "mujoco-mjx", "jax", "numpy")


def batch_metadata(lanes: int) -> dict[str, str]:
    """Returns the lanes of a chunk under ``lanes``, and the versions of the packages that decide results, by package.

    Which engines and kinds of device ran stands in each row. The machine's name and cores decide no result, so that
    they are in the batch's record alone (``tasks.simulate.machines``), and the tables are the same bytes elsewhere.
    """
    return {"lanes": str(lanes), **{package: version(package) for package in _PACKAGES}}
