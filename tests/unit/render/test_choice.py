"""If this fails, a scene's keys go to a node that only stores, or to keys that a node has put in another's place, or to nobody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import pytest

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.crypto import MemberSecrets
from scenefold.render.choice import OTHER_KEYS, REVOKED, STRANGE, TOO_MANY, UNKNOWN, Renderers, choose
from scenefold.scene.log import Granted
from scenefold.wire import KeyEntry, LogEntry, RevokeNode, Role
from scenefold.wire.enrol_entries import Trust
from scenefold.world.log_view import LogView, NodeKeys
from unit.peer.logs_made import LOG_KEY, add, found, key_of, node, record, remove, secrets_of, signed

COUNT = 4
MEMBERS: list[LogEntry] = [add(number) for number in range(COUNT)]


def keys_of(number: int) -> NodeKeys:
    own = secrets_of(number)
    return NodeKeys(own.signing.public.raw, own.sealing.public.raw)


CERTIFIED = {node(number): keys_of(number) for number in range(COUNT)}


def trust(number: int) -> Trust:
    return Trust(node(number), True, secrets_of(number).sealing.public.raw)


def granted(number: int, keys: MemberSecrets | None = None, role: Role = Role.READER) -> Granted:
    own = secrets_of(number) if keys is None else keys
    signing, sealing = own.signing.public, own.sealing.public
    return Granted(f"node:{node(number)}", role, KeyEntry(signing.suite, signing.raw), KeyEntry(sealing.suite, sealing.raw), 2)


def view_of(*entries: LogEntry) -> LogView:
    """What a client knows after these entries."""
    view = LogView()
    for entry in entries:
        view, _ = view.after([signed(record(view, entry))], LOG_KEY.public)  # type: ignore[arg-type]  # a view is enough
    return view


def chosen(
    *entries: LogEntry,
    grants: Sequence[Granted] = (),
    certified: Mapping[NodeId, NodeKeys] = CERTIFIED,
    problems: Mapping[NodeId, str] = MappingProxyType({}),
) -> Renderers:
    return choose(view_of(found(COUNT), *MEMBERS, *entries), grants, certified, problems)


def why(renderers: Renderers) -> dict[int, str]:
    return {one.node - node(0): one.why for one in renderers.left_out}


def test_of_a_new_cluster_only_the_first_node_renders() -> None:
    seen = chosen()
    assert seen.nodes == (node(0),)
    assert why(seen) == dict.fromkeys((1, 2, 3), STRANGE)


def test_trusted_and_granted_nodes_render_in_the_order_of_the_line() -> None:
    seen = chosen(trust(3), grants=(granted(2), granted(1, role=Role.WRITER)))
    assert seen.nodes == tuple(node(number) for number in range(COUNT)) and not seen.left_out
    for number in range(COUNT):
        assert seen.sealing[node(number)] == secrets_of(number).sealing.public


def test_whose_trust_was_withdrawn_is_left_out_unless_it_is_granted_the_scene() -> None:
    ended = trust(1), Trust(node(1), False)
    assert why(chosen(*ended)) == dict.fromkeys((1, 2, 3), STRANGE)
    assert chosen(*ended, grants=(granted(1),)).nodes == (node(0), node(1))


def test_a_revoked_node_is_left_out_whatever_it_was_granted() -> None:
    revoked = RevokeNode(node(1), key_of(1).public.key_id)
    seen = chosen(trust(1), revoked, grants=(granted(1),))
    assert seen.nodes == (node(0),) and why(seen)[1] == REVOKED


def test_who_is_no_member_is_not_chosen_and_not_told_of() -> None:
    seen = chosen(trust(2), trust(9), remove(2), grants=(granted(2), granted(9)), certified={**CERTIFIED, node(9): keys_of(9)})
    assert seen.nodes == (node(0),) and list(why(seen)) == [1, 3]


def test_who_came_back_to_another_place_renders_there() -> None:
    seen = chosen(trust(2), remove(2), add(2, left_of=0, life=1))
    assert seen.nodes == (node(2), node(0))


@pytest.mark.parametrize("part", ["signing", "sealing"])
def test_a_grant_is_for_the_keys_that_it_names(part: str) -> None:
    """A node that lost its disk has new keys; and a user may be named like a node only by the authority."""
    other = replace(secrets_of(1), **{part: getattr(secrets_of(9), part)})
    assert why(chosen(grants=(granted(1, other),)))[1] == STRANGE
    assert why(chosen(grants=(replace(granted(1), name="node:5"),)))[1] == STRANGE


@pytest.mark.parametrize("part", ["signing", "sealing"])
def test_a_member_under_other_keys_than_certified_is_left_out(part: str) -> None:
    """Who decides the log may not put a key of its own in the place of a trusted node's."""
    other = keys_of(1)._replace(**{part: getattr(keys_of(9), part)})
    seen = chosen(trust(1), certified={**CERTIFIED, node(1): other})
    assert seen.nodes == (node(0),) and why(seen)[1] == OTHER_KEYS


def test_of_whom_no_certificate_is_known_is_left_out_with_the_reason() -> None:
    seen = chosen(trust(1), trust(2), certified={node(0): keys_of(0)}, problems={node(1): "its certificate: it ran out"})
    assert seen.nodes == (node(0),)
    assert (why(seen)[1], why(seen)[2]) == ("its certificate: it ran out", UNKNOWN)


def test_more_than_a_job_may_have_are_left_out() -> None:
    count = POOL_NODES_MAX + 2
    everybody = [entry for number in range(count) for entry in (add(number), trust(number))]
    certified = {node(number): keys_of(number) for number in range(count)}
    seen = choose(view_of(found(count), *everybody), (), certified, {})
    assert len(seen.nodes) == POOL_NODES_MAX
    assert why(seen) == {POOL_NODES_MAX: TOO_MANY, POOL_NODES_MAX + 1: TOO_MANY}


def test_if_nobody_may_render_the_error_says_what_to_do() -> None:
    chosen(trust(1)).check_any("kitchen")
    nobody = chosen(trust(1), Trust(node(0), False), Trust(node(1), False))
    with pytest.raises(LocalFault) as caught:
        nobody.check_any("kitchen")
    with pytest.raises(LocalFault, match="no node may render"):
        choose(LogView(), (), CERTIFIED, {}).check_any("kitchen")
    assert "kitchen" in caught.value.where and STRANGE in caught.value.where
    assert "scenectl scene grant kitchen" in caught.value.remedy and "scenectl cluster trust" in caught.value.remedy
