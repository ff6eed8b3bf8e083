"""What a batch's numbers depend on besides its documents."""

from importlib.metadata import version

_PACKAGES = ("simyard", "mujoco", "mujoco-mjx", "jax", "numpy")


def batch_metadata(engine: str) -> dict[str, str]:
    """Returns the engine under ``engine``, and the versions of the packages that decide results, by package."""
    return {"engine": engine, **{package: version(package) for package in _PACKAGES}}
