"""If this fails, a client believes what a node shows it of a scene's log, and the node that decides has not decided it so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable
from scenefold.client import offers
from scenefold.client.scene import Scene
from scenefold.crypto import SigningKey
from scenefold.scene.log import Followed, Undecided, decided, follow, open_private, seal_private
from scenefold.wire import (
    AcceptSceneProposal,
    Decision,
    KeyEpoch,
    Packet,
    ProposeSceneLog,
    RequestSceneLog,
    RespondSceneLog,
    Role,
    SceneLogPublic,
)
from scenefold.world import Priority
from unit.client.fake_nodes import KEEPER_KEY
from unit.client.test_grants import Studio, card_of
from unit.client.test_old_headers import Liars
from unit.scene.log.members import secrets_of

LIAR, KEEPER = "127.0.0.3", "127.0.0.2"
EVIL = SigningKey(b"e" * 32)


async def a_proposal(studio: Studio) -> tuple[Scene, Followed]:
    """A scene of three users; and what Ada, an owner, makes to follow, which nobody has decided."""
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(3), Role.WRITER)
    await scene.grant(card_of(2), Role.OWNER)
    ada = await studio.kitchen(2)
    assert ada.access.log is not None
    read, keys = await ada.access.read_log(), ada.access.log.keys
    record = read.state.next_record(KeyEpoch(1, keys.epochs[0]), bytes(16), read.header.origin)
    token = ada.access.calls.world.entropy.token
    return scene, follow(read.header, read.log, record, keys, secrets_of(2).signing, token).sealed()


LIES: dict[str, Callable[[SceneLogPublic], SceneLogPublic]] = {
    "undecided": lambda header: header,
    "decided by a stranger": lambda header: decided(header, EVIL),
    "decided by an owner": lambda header: decided(header, secrets_of(2).signing),
    "decided in another form": lambda header: replace(header, decision=Decision(3, (bytes(64),))),
    "another deciding key": lambda header: decided(replace(header, origin_key=EVIL.public.raw), EVIL),
}


@pytest.mark.parametrize("lie", LIES)
async def test_a_header_that_was_only_proposed_is_believed_by_nobody(lie: str, autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    scene, proposed = await a_proposal(studio)
    decided_position = scene.access.identity.position
    shown = LIES[lie](proposed.header)
    Liars(studio, {LIAR: shown})
    for number in (1, 3):
        opened = await studio.kitchen(number)
        assert (opened.access.identity.position, opened.access.identity.key_epoch) == (decided_position, 0)
    Liars(studio, dict.fromkeys(studio.nodes.addresses, shown))
    for number in (1, 3):
        with pytest.raises(DamagedData):
            await studio.kitchen(number)
    with pytest.raises(DamagedData):
        await scene.members()
    assert scene.access.identity.position == decided_position


async def test_it_is_said_that_a_header_was_not_decided(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    _, proposed = await a_proposal(studio)
    Liars(studio, dict.fromkeys(studio.nodes.addresses, proposed.header))
    with pytest.raises(Undecided, match="was proposed, and nobody shows that it was decided"):
        await studio.kitchen(1)


@pytest.mark.expect_log("nobody shows that it was decided")
async def test_what_was_not_decided_is_no_gift_and_stands_in_no_list(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    scene, proposed = await a_proposal(studio)
    studio.nodes.headers[scene.id] = proposed.header
    assert await studio.scenes(3).list() == []
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await studio.scenes(3).open("kitchen")


class LyingRelay:
    """A node that hands no proposal on, and calls it accepted."""

    def __init__(self, studio: Studio, decision: Callable[[ProposeSceneLog], Decision | None]) -> None:
        self._honest = studio.nodes.request
        self._decision = decision
        studio.nodes.request = self.request  # type: ignore[method-assign]

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, ProposeSceneLog) and address != KEEPER:
            decision = self._decision(packet)
            return AcceptSceneProposal(packet.public.position, packet.public.log_hash, decision)
        return await self._honest(address, priority, packet, timeout)


@pytest.mark.parametrize("signer", [None, EVIL, secrets_of(1).signing], ids=["nobody", "a stranger", "the author"])
async def test_who_calls_a_change_decided_has_to_show_it(signer: SigningKey | None, autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    scene, _ = await a_proposal(studio)
    LyingRelay(studio, lambda packet: None if signer is None else decided(packet.public, signer).decision)
    studio.nodes.away = {KEEPER}
    before = scene.access.identity
    with pytest.raises(Unreachable):
        await scene.rotate_key()
    with pytest.raises(Unreachable):
        await studio.scenes(1).create("garden")
    assert scene.access.identity == before
    studio.nodes.away = set()
    assert (await scene.rotate_key()).key_epoch == 1
    assert (await studio.scenes(1).create("garden")).name == "garden", "its keys were kept"


async def test_a_decision_is_verified_once(autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By who asked for it; that it is verified at all is the test before."""
    studio = Studio(tmp_path)
    scene = await studio.scenes(1).create("kitchen")
    verified: list[int] = []
    monkeypatch.setattr(offers, "check_decided", lambda header: verified.append(header.position))
    await scene.grant(card_of(2), Role.WRITER)
    assert verified == [scene.access.identity.position]


async def test_an_old_decision_decides_nothing_new(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    scene, proposed = await a_proposal(studio)
    older = studio.nodes.headers[scene.id].decision
    Liars(studio, dict.fromkeys(studio.nodes.addresses, replace(proposed.header, decision=older)))
    with pytest.raises(Undecided, match="not decided by the node that decides"):
        await studio.kitchen(3)


class LogLiar:
    """Nodes that show another sealed log than their header names."""

    def __init__(self, studio: Studio, bent: Callable[[bytes], bytes]) -> None:
        self._honest = studio.nodes.request
        self._bent = bent
        studio.nodes.request = self.request  # type: ignore[method-assign]

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        reply = await self._honest(address, priority, packet, timeout)
        if isinstance(packet, RequestSceneLog) and isinstance(reply, RespondSceneLog) and reply.answer and reply.answer.private:
            return RespondSceneLog(replace(reply.answer, private=self._bent(reply.answer.private)))
        return reply


@pytest.mark.parametrize("what", ["garbage", "nothing much", "one bit", "an older log", "one that was sealed anew"])
async def test_a_log_that_is_not_its_headers_is_not_believed(what: str, autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    scene = await studio.scenes(1).create("kitchen")
    older = dict(studio.nodes.logs)[scene.id]
    await scene.grant(card_of(3), Role.READER)
    lies: dict[str, Callable[[bytes], bytes]] = {
        "garbage": lambda private: bytes(len(private)),
        "nothing much": lambda _: b"\0",
        "one bit": lambda private: private[:-1] + bytes([private[-1] ^ 1]),
        "an older log": lambda _: older,
        "one that was sealed anew": lambda _: _resealed(studio, scene),
    }
    LogLiar(studio, lies[what])
    reader = await studio.kitchen(3)
    with pytest.raises(DamagedData, match="not the one that its header names"):
        await reader.spaces()


def _resealed(studio: Studio, scene: Scene) -> bytes:
    """By a reader: everybody who has the key can seal the same records under another nonce."""
    header, log = studio.nodes.headers[scene.id], scene.access.log
    assert log is not None
    opened = open_private(
        studio.nodes.logs[scene.id],
        genesis=header.genesis,
        position=header.position,
        symmetric_key=log.keys.epochs.newest,
        header_key=log.keys.header_key,
    )
    return seal_private(opened.records, genesis=header.genesis, symmetric_key=log.keys.epochs.newest, key_epoch=0, nonce=bytes(12))


@pytest.mark.expect_log("decided position 4 twice")
async def test_of_two_headers_of_one_position_the_one_that_was_met_counts(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    scene, proposed = await a_proposal(studio)
    await scene.rotate_key()
    taken, other = studio.nodes.headers[proposed.header.scene], decided(proposed.header, KEEPER_KEY)
    assert (taken.position, taken.key_epoch) == (other.position, other.key_epoch) and taken != other
    ben = await studio.kitchen(3)
    Liars(studio, {LIAR: other})
    for opened in (await studio.kitchen(3), await studio.kitchen(1)):
        assert opened.access.identity.keys == ben.access.identity.keys
    Liars(studio, dict.fromkeys(studio.nodes.addresses, other))
    await ben.access.refresh()
    assert ben.access.identity.position == taken.position
    with pytest.raises(Refused, match="another header of position 4 is shown"):
        await studio.kitchen(3)
    # What never was met has nothing to compare with.
    assert (await studio.kitchen(2)).access.identity.position == other.position
