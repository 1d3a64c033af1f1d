"""One step: what a node does about one log when something happens (specs/25-consensus.md).

Whoever runs this gives every event, with what the world looks like then, to `take`; carries out the effects of the step in their
order; and keeps the state after it only if the first of them, should it write, has succeeded (effects.py). Everything else,
losing messages, repeating them, doing without timers, or beginning anew from the disk, is slow at worst.
"""

from __future__ import annotations

from scenefold.consensus import acceptor, hops, learning, proposer
from scenefold.consensus.case import Case
from scenefold.consensus.effects import Outcome, Reply, Step
from scenefold.consensus.events import Ask, Event, Lost, Received, Started, TimeOver, View
from scenefold.consensus.messages import AskLog, Learn, Propose
from scenefold.consensus.state import Setting, State
from scenefold.consensus.timing import Timer, Waits


def take(setting: Setting, state: State, event: Event, view: View) -> Step[State]:
    """The step that an event leads to."""
    case = Case(setting, state, view)
    match event:
        case Started():
            _start(case)
        case Ask():
            proposer.ask(case, event)
        case Received():
            _receive(case, event)
        case TimeOver(timer):
            _time_over(case, timer)
        case Lost(node):
            hops.lose_link(case, node)
            proposer.lose_link(case, node)
            case.lose_link(node)
    if case.decided is not None:
        proposer.decided(case)
    return case.step()


def _start(case: Case) -> None:
    """What was exposed before is unknown until the position is decided; but whoever waits here, and was told nothing yet, hears of its end."""
    waited_for = {case.proposal.digest} if case.proposal.is_asked else set()
    for digest in sorted(case.slot.exposed - waited_for):
        case.do(Reply(digest, Outcome.UNKNOWN, case.open_position))
    case.watch()


def _receive(case: Case, event: Received) -> None:
    message = event.message
    match message:
        case Propose():
            acceptor.visit(case, event.sender, message)
        case Learn() | AskLog():
            learning.learn(case, event.sender, message)
        case _ if message.proposal.ballot.node == case.me:
            proposer.answered(case, event.sender, message)
        case _:
            hops.come_home(case, event.sender, message)


def _time_over(case: Case, timer: Timer) -> None:
    match timer:
        case Timer(Waits.ANSWERS, proposal):
            proposer.pass_over(case, proposal)
        case Timer(Waits.REST, proposal):
            proposer.rested(case, proposal)
        case Timer(Waits.HOP, proposal) if proposal is not None:
            hops.hop_over(case, proposal)
        case Timer(Waits.DEADLINE):
            proposer.late(case)
        case _:
            proposer.orphaned(case)
