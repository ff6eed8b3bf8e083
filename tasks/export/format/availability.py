"""Which formats can be written here: two need libraries that not everybody wants."""

from collections.abc import Collection, Mapping
from importlib.util import find_spec

from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.world_sections import WorldFormat

_EXTRAS: Mapping[WorldFormat, tuple[str, ...]] = {"glb": ("trimesh", "PIL"), "usd": ("pxr",)}


def require_writable(formats: Collection[WorldFormat], source: str, path: str = "formats") -> None:
    """Refuses formats whose writers are not installed here; ``path`` is where the document has them.

    Raises:
        DocumentError: Some are not; says what to install.
    """
    missing = [name for name in sorted(set(formats)) if not _is_installed(name)]
    if missing:
        faults = [
            Fault(path=path, value=name, allowed=f"a format that is installed: pip install 'simyard[{name}]'")
            for name in missing
        ]
        raise DocumentError(faults, source=source)


def _is_installed(name: WorldFormat) -> bool:
    return all(find_spec(module) is not None for module in _EXTRAS.get(name, ()))
