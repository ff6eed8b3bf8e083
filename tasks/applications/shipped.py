"""Where the applications lie that come with Simyard."""

from pathlib import Path

_HOMES = (
    Path(__file__).parent / "shipped",  # in a wheel
    Path(__file__).parents[2] / "applications",  # in the repository
)


def shipped_application(name: str) -> Path | None:
    """Returns the folder of an application that comes with Simyard, or None when none has that name."""
    return next((home / name for home in _HOMES if name in _names(home)), None)


def _names(home: Path) -> list[str]:
    # A listing, not a path made from the name, so that no name can lead elsewhere.
    return [path.name for path in home.iterdir() if path.is_dir()] if home.is_dir() else []
