"""How the nodes that decide a log agree on its next value (specs/25-consensus.md). Pure: no clock, dice, network or disk.

`take` answers one event with a `Step`: a new `State`, and effects to be carried out in their order. A log brings its `Judge`, and
a node its `Setting`. What may happen at all stands in four tables, ACCEPTOR, HOPS, LEARNING and PROPOSER.
"""

from scenefold.consensus.certificates import Certificate
from scenefold.consensus.effects import Decide, Effect, Outcome, Persist, Reply, Send, SetTimer, Step, Tell
from scenefold.consensus.events import Ask, Event, Lost, Received, Started, TimeOver, View
from scenefold.consensus.facts import Fact, Promise, Refusal, Vote
from scenefold.consensus.machine import take
from scenefold.consensus.messages import Accepted, AskLog, Learn, Message, Propose, Rejected
from scenefold.consensus.participants import Participant, Participants
from scenefold.consensus.slots import Slot, Tentative
from scenefold.consensus.state import Setting, Stage, State
from scenefold.consensus.timing import Timer, Timing, Waits
from scenefold.consensus.values import Judge, Value

__all__ = [
    "Accepted",
    "Ask",
    "AskLog",
    "Certificate",
    "Decide",
    "Effect",
    "Event",
    "Fact",
    "Judge",
    "Learn",
    "Lost",
    "Message",
    "Outcome",
    "Participant",
    "Participants",
    "Persist",
    "Promise",
    "Propose",
    "Received",
    "Refusal",
    "Rejected",
    "Reply",
    "Send",
    "SetTimer",
    "Setting",
    "Slot",
    "Stage",
    "Started",
    "State",
    "Step",
    "Tell",
    "Tentative",
    "TimeOver",
    "Timer",
    "Timing",
    "Value",
    "View",
    "Vote",
    "Waits",
    "take",
]
