"""The services by which copies are kept: who holds what is told, stored, compared, recovered (specs/20-copies.md).

What is known about copies is a value that changes with the arc (peer/copies, kept by the line's keeper); here are the tasks and
handlers that act on it.
"""

from scenefold.peer.replication.replication import Replication

__all__ = ["Replication"]
