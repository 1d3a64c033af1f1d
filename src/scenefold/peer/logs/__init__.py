"""The logs that several nodes decide, as a node runs them: the machine of consensus/ with a disk, a clock and links
(specs/25-consensus.md, On a node).

    packets -> Logs -> Inbox -> Log -> take(...) -> write, then -> Courier -> Carrier
    clients -> Log.ask -> Asking -^     Timers -^

`Log` is one task for each log. What it is of (a scene's, the cluster's) its judge and its `Owner` know, how packets travel its `Carrier`.
"""

from scenefold.peer.logs.asking import Answer
from scenefold.peer.logs.log import AT_ONCE_BYTES, Log, open_log
from scenefold.peer.logs.logs import Logs
from scenefold.peer.logs.ports import Carrier, Owner, Surroundings

__all__ = ["AT_ONCE_BYTES", "Answer", "Carrier", "Log", "Logs", "Owner", "Surroundings", "open_log"]
