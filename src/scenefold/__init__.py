"""Scenefold: path-traced scenes on a handful of ordinary computers, without a master."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenefold.client import Cluster, Scene, Space, connect

__version__ = "0.1.0"

_FROM_CLIENT = ("Cluster", "Scene", "Space", "connect")


def __getattr__(name: str) -> Any:
    # Late, so that `import scenefold` costs nothing: the client brings Trio, cryptography and numpy.
    if name not in _FROM_CLIENT:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import scenefold.client

    return getattr(scenefold.client, name)


__all__ = ["Cluster", "Scene", "Space", "__version__", "connect"]
