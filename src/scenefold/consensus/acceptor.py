"""Guards and actions of the acceptor's table (specs/25-consensus.md, The acceptor)."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus.acceptor_table import ACCEPT, ACCEPTOR, PREPARE
from scenefold.consensus.ballots import is_first
from scenefold.consensus.case import Case
from scenefold.consensus.certificates import certificate_of
from scenefold.consensus.choosing import highest_of, named_highest
from scenefold.consensus.effects import Tell
from scenefold.consensus.facts import Refusal, merged, signed, true_facts
from scenefold.consensus.hops import hand_on_from
from scenefold.consensus.messages import Accepted, Propose, Rejected
from scenefold.consensus.tables import Row, acting, first_fit, named
from scenefold.wire import Phase


class Visit:
    """A proposal that is here. Its facts are those that hold, as far as this node can tell."""

    def __init__(self, case: Case, sender: NodeId, message: Propose) -> None:
        self.case, self.sender, self.message = case, sender, message
        self.ballot, self.origin = message.proposal.ballot, message.proposal.ballot.node
        self.row: Row | None = None
        self.slot = case.slot
        self.facts, self.highest = message.facts, message.highest
        if message.proposal.position == case.open_position:
            digest, genesis = message.digest, case.setting.genesis
            self.facts = merged(true_facts(message.facts, message.proposal, digest, genesis, case.participants))
            self.highest = highest_of(self.facts, () if message.highest is None else (message.highest,))

    @property
    def is_news(self) -> bool:
        """Whether it shows that somebody is at it: who has kept a packet can send it again at any time."""
        return self.case.slot != self.slot or self.sender in self.case.participants.nodes


def visit(case: Case, sender: NodeId, message: Propose) -> None:
    """Take the row that fits."""
    guest = Visit(case, sender, message)
    event = PREPARE if message.proposal.phase is Phase.PREPARE else ACCEPT
    guest.row = first_fit(ACCEPTOR, event, None, GUARDS, guest)
    assert guest.row is not None, "the last rows have no guards"
    for name in guest.row.do:
        ACTIONS[name](guest)


# ------------------------------------------------------------------------------------------------------------ guards


def of_another_log(guest: Visit) -> bool:
    """it names another genesis"""
    return guest.message.genesis != guest.case.setting.genesis


def my_own(guest: Visit) -> bool:
    """this node is its originator"""
    return guest.origin == guest.case.me


def without_a_value(guest: Visit) -> bool:
    """there is nothing in it to vote for"""
    return guest.message.value is None


def decided_already(guest: Visit) -> bool:
    """L ≤ c"""
    return guest.message.proposal.position <= guest.case.state.position


def too_far_ahead(guest: Visit) -> bool:
    """L > c + 1"""
    return guest.message.proposal.position > guest.case.open_position


def takes_no_part(guest: Visit) -> bool:
    """this incarnation of this node is not in P(L)"""
    return not guest.case.takes_part


def not_of_a_participant(guest: Visit) -> bool:
    """no node of P(c + 1) has brought it: whatever it holds, this node is not made to carry and keep it"""
    return guest.sender not in guest.case.participants.nodes


def of_a_stranger(guest: Visit) -> bool:
    """no node of P(L) has the id in the ballot, or what it says of itself is said by another incarnation"""
    member = guest.case.participants.member_of(guest.origin)
    return member is None or any(fact.member.node == guest.origin and fact.member != member for fact in guest.message.facts)


def not_first(guest: Visit) -> bool:
    """it is a first ballot, and is not voted in, or its node is not the first of P(L)"""
    is_voting = guest.message.proposal.phase is Phase.ACCEPT
    return is_first(guest.ballot) and not (is_voting and guest.origin == guest.case.participants.first)


def not_of_its_originator(guest: Visit) -> bool:
    """no true fact of the originator for this ballot (and value) is among its facts"""
    return all(fact.member.node != guest.origin for fact in guest.facts)


def route_incomplete(guest: Visit) -> bool:
    """a node of P(L) is not on the route"""
    return not guest.case.participants.nodes <= set(guest.message.route)


def below_promised(guest: Visit) -> bool:
    """its ballot is below `promised`"""
    return guest.ballot < guest.case.slot.promised


def has_voted_in_it(guest: Visit) -> bool:
    """`accepted` is of this ballot: its first phase is over"""
    return guest.case.slot.accepted_ballot == guest.ballot


def has_voted_otherwise_in_it(guest: Visit) -> bool:
    """`accepted` is of this ballot, and another value"""
    return guest.case.slot.accepted_ballot == guest.ballot and guest.case.slot.accepted_digest != guest.message.digest


def another_is_at_it(guest: Visit) -> bool:
    """`accepted` was heard of less than T_ORPHAN ago; its originator is another one, seems alive, and no link to it was lost since (a courtesy)"""
    case, accepted = guest.case, guest.case.slot.accepted
    if accepted is None or accepted.ballot.node in (guest.origin, case.me) or accepted.ballot.node not in case.view.alive:
        return False
    if accepted.ballot == case.state.orphaned:
        return False
    return case.view.now - case.state.heard_at < case.setting.timing.orphan_s(len(case.participants.everyone), 0)[0]


def ill_formed(guest: Visit) -> bool:
    """it brings a value that the judge refuses at L"""
    value = guest.message.value
    return value is not None and guest.case.state.judge.refuses(value) is not None


def cannot_write(guest: Visit) -> bool:
    """the disk refuses"""
    return not guest.case.view.can_write


def abstains(guest: Visit) -> bool:
    """this node must not vote for that yet (26-modes)"""
    return guest.case.view.abstains


def nothing_begun(guest: Visit) -> bool:
    """it is no takeover, `accepted` is none, and no fact names a ballot voted in"""
    is_named = named_highest(guest.facts) is not None
    begun = guest.case.slot.accepted is not None or is_named or guest.message.takeover
    return not begun


def does_not_suit(guest: Visit) -> bool:
    """this node has something against it now (26-modes)"""
    return guest.case.view.veto is not None


# ----------------------------------------------------------------------------------------------------------- actions


def refuse(guest: Visit) -> None:
    """answer 9 with this reason; the arm ends here"""
    assert guest.row is not None and guest.row.reason is not None
    _refuse(guest, guest.row.reason)


def refuse_as_it_says(guest: Visit) -> None:
    """likewise, with the reason that it has"""
    _refuse(guest, guest.case.view.veto or RejectReason.BUSY)


def _refuse(guest: Visit, reason: RejectReason) -> None:
    case, message = guest.case, guest.message
    plain = Refusal(message.proposal, reason, case.slot.promised, case.setting.me)
    refusal = signed(plain, case.setting.genesis, case.setting.key)
    case.send(guest.sender, Rejected(message.genesis, message.proposal, message.digest, refusal, guest.facts))


def tell_log(guest: Visit) -> None:
    """send what is decided from L on, to whoever brought it and, if it is of P(c + 1), to the originator"""
    origin = {guest.origin} & guest.case.participants.nodes
    for target in dict.fromkeys((guest.sender, *origin)):
        guest.case.do(Tell(target, guest.message.proposal.position - 1))


def ask_log(guest: Visit) -> None:
    """ask for what is decided above c (5): the originator, or whoever brought it if that is no node of P(c + 1), unless a participant was asked less than 0.9 s ago, or another one if it is none"""
    guest.case.ask_log(guest.sender if not_of_a_participant(guest) else guest.origin)


def promise(guest: Visit) -> None:
    """`promised` becomes this ballot, durably; the own promise joins the facts, and `accepted` those of which the highest goes on"""
    accepted = guest.case.slot.accepted
    guest.facts = merged(guest.facts, (guest.case.promise(guest.ballot),))
    # Its own bytes first: these were judged.
    known = (None if accepted is None else accepted.value, guest.highest)
    guest.highest = highest_of(guest.facts, [value for value in known if value is not None])


def vote(guest: Visit) -> None:
    """`promised` becomes this ballot, `accepted` this ballot and value, durably; the own vote joins the facts"""
    assert guest.message.value is not None
    guest.facts = merged(guest.facts, (guest.case.vote(guest.ballot, guest.message.value),))
    if guest.is_news:
        guest.case.find_link()


def count(guest: Visit) -> None:
    """if the facts are a certificate: L is decided here"""
    case, message = guest.case, guest.message
    proven = certificate_of(case.open_position, guest.ballot, message.digest, guest.facts, case.participants)
    if proven is not None:
        assert message.value is not None
        case.decide(message.value, proven)


def hear(guest: Visit) -> None:
    """the wait for T_ORPHAN begins anew, unless this is known here and somebody else has brought it: whoever has kept a packet"""
    if guest.case.decided is None and guest.is_news:
        guest.case.hear()


def turn_back(guest: Visit) -> None:
    """answer 8 with the facts that came, so that nobody waits for this arm"""
    message = guest.message
    guest.case.send(guest.sender, Accepted(message.genesis, message.proposal, message.digest, message.facts))


def hand_on(guest: Visit) -> None:
    """send it to the next of the route that can be reached, and wait T_HOP for each further one; if there is none: answer 8"""
    hand_on_from(guest.case, guest.sender, replace(guest.message, facts=guest.facts, highest=guest.highest))


GUARDS = named(
    (
        of_another_log,
        my_own,
        without_a_value,
        decided_already,
        too_far_ahead,
        takes_no_part,
        not_of_a_participant,
        of_a_stranger,
        not_first,
        not_of_its_originator,
        route_incomplete,
        below_promised,
        has_voted_in_it,
        has_voted_otherwise_in_it,
        another_is_at_it,
        ill_formed,
        cannot_write,
        abstains,
        nothing_begun,
        does_not_suit,
    )
)
ACTIONS = acting((refuse, refuse_as_it_says, tell_log, ask_log, turn_back, promise, vote, count, hear, hand_on))
