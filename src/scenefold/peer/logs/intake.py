"""Packets of those who decide logs, on their way to the log that they are about (specs/25-consensus.md, Packets).

They go one way, and what comes of them is sent by the log. Whoever takes part in a log may say what he likes about it: he could as well
refuse to decide. What others say is looked at as well, since they may know more than this node, or less, but only so much of it: each packet may
bring some dozens of signatures.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from scenefold.base.ids import NodeId
from scenefold.consensus import AskLog, Message, Propose
from scenefold.consensus.packets import messages_of
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.logs.log import Log
from scenefold.peer.logs.logs import Logs
from scenefold.wire import AcceptValue, Packet, ProposeValue, RejectValue
from scenefold.world import Clock, QuietLog
from scenefold.world.buckets import Buckets

STRANGERS_BURST = 64
STRANGERS_PER_S = 16.0
"""Messages of a node about logs in which it takes no part, as far as is known here."""
ASKING_COUNTS = 8
"""Such messages that a question counts as, and what is proposed at a position that is decided: both are answered with 4 MiB."""

_log = logging.getLogger("scenefold.peer.logs")


class Intake:
    """Used from the Trio thread only."""

    def __init__(self, clock: Clock, logs: Logs) -> None:
        self._clock, self._logs = clock, logs
        self._of_strangers = Buckets(STRANGERS_BURST, STRANGERS_PER_S)
        self._quiet = QuietLog(_log)
        self.watch: Callable[[bytes, Packet], object] = lambda *_: None
        """Called with each packet that is looked at, and the log that it is about: what it shows may mean more than what is to be decided."""
        self.watches: Callable[[bytes], bool] = lambda _: False
        """Whether packets are looked at that are about a log which does not run here."""

    def register(self, handlers: Handlers) -> None:
        """Packets 7 to 9. Those of 5 and 6 that are about decisions come through the cluster's log, which answers the others."""
        for packet in (ProposeValue, AcceptValue, RejectValue):
            handlers.add(packet, self._on_packet, senders=Senders.NODES)

    async def _on_packet(self, packet: Packet, peer: str) -> None:
        self.take(packet, peer)

    def take(self, packet: Packet, peer: str) -> None:
        """A packet of a node, for whichever log it is about. Returns at once; what is about none that runs here, or is too much, is lost."""
        sender = node_of(peer)
        if sender is None:
            return
        about: set[bytes] = set()
        for message in messages_of(packet):
            log = self._logs.of(message.genesis)
            if log is not None and self._is_welcome(log, sender, message):
                log.receive(sender, message)
                about.add(message.genesis)
            elif log is None and self.watches(message.genesis) and self._may_say(sender, message):
                about.add(message.genesis)
        for genesis in about:
            self.watch(genesis, packet)

    def _is_welcome(self, log: Log, sender: NodeId, message: Message) -> bool:
        return sender in log.judge.participants.nodes or self._may_say(sender, message)

    def _is_answered_at_length(self, message: Message) -> bool:
        if isinstance(message, Propose):
            log = self._logs.of(message.genesis)
            return log is not None and message.proposal.position <= log.position
        return isinstance(message, AskLog)

    def _may_say(self, sender: NodeId, message: Message) -> bool:
        now, count = self._clock.now(), ASKING_COUNTS if self._is_answered_at_length(message) else 1
        if self._of_strangers.take(str(sender), now, count):
            return True
        self._quiet.say(now, f"node:{sender}", "log", "it says more about logs in which it takes no part than is looked at")
        return False
