"""One node: services, renderer, start and stop; and several nodes on this machine."""

from scenefold.node.running import default_extensions, run_node
from scenefold.peer import Extension, NodeContext, NodeSettings

__all__ = ["Extension", "NodeContext", "NodeSettings", "default_extensions", "run_node"]
