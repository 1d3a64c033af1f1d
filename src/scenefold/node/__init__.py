"""One node: services, renderer, start and stop; and several nodes on this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenefold.node.running import default_extensions, run_node
    from scenefold.peer import Extension, NodeContext, NodeSettings

__all__ = ["Extension", "NodeContext", "NodeSettings", "default_extensions", "run_node"]

_OF_RUNNING = ("default_extensions", "run_node")


def __getattr__(name: str) -> Any:
    # Late, so that `python -m scenefold.node` can say what a signal does before it imports a node.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import scenefold.node.running
    import scenefold.peer

    return getattr(scenefold.node.running if name in _OF_RUNNING else scenefold.peer, name)
