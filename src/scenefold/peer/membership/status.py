"""What this node says about itself: a signed Status once in a while, a MiniStatus on every packet (thesis C.1).

Lamport time is (boot, counter), joined to 64 bits: the boot counter of the data folder is durable, so a restarted
node begins above all that it said before, without writing anything down while it runs. What it owns and how far it
knows the cluster's log are set by those whose business that is, at the moment that it is durable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, Arc, Location
from scenefold.base.prefixes import Blacklist
from scenefold.crypto import STATUS_DOMAIN, MemberSecrets, SigningKey
from scenefold.wire import Member, MiniStatus, Status

TELL_S = 0.02
"""For each member, between two statuses that tell all of a changed arc or fill: 50 small datagrams a second at most."""
TELL_BYTES_MIN = 64 * 1024
TELL_FILL = 1 / 64
"""A fill that has changed by so much, of itself, is told: less than what balance leaves alone."""
_BLOCK_BYTES = 4096
_FRACTION_ONE = 1 << 32
_U32_MAX = _FRACTION_ONE - 1
_LAST_FOLLOWED = _FRACTION_ONE - (1 << 30)
"""Who hurries our counter on must not use it up: what is left lasts for years."""


@dataclass(frozen=True, slots=True)
class Load:
    """What changes while a node runs. Bytes used and there are, rays, and the pool that it renders in."""

    disk_used_bytes: int = 0
    disk_total_bytes: int = 0
    memory_used_bytes: int = 0
    memory_total_bytes: int = 0
    rays_per_second: int = 0
    ray_queue_length: int = 0
    render_pool: int = 0
    scene_frame: int = 0


class OwnStatus:
    """The author of this node's statuses. Used from the Trio thread only."""

    def __init__(self, me: NodeId, address: str, incarnation: bytes, boot: int, secrets: MemberSecrets) -> None:
        assert 0 <= boot <= _U32_MAX
        self._lamport = boot << 32
        self.secrets = secrets
        """What it signs with, and what is sealed to it."""
        self._basis = Status(lamport=0, node=me, incarnation=incarnation, boot=boot, address=address)
        self.load = Load()
        self.arc: Arc | None = None
        """What this node owns, as it is durable; None: nothing."""
        self.recovers = False
        """Whether a part of that is not recovered, or was not when `load` was measured: nobody knows yet how much lies there."""
        self.blacklist = Blacklist()
        """Which nodes must hold no copies of that, as it is durable."""
        self.log_position = 0
        """How far this node knows the cluster's log."""
        self.is_registered = True
        """Whether the log, as far as that, has this node under its incarnation."""

    @property
    def me(self) -> NodeId:
        return self._basis.node

    @property
    def incarnation(self) -> bytes:
        return self._basis.incarnation

    @property
    def boot(self) -> int:
        return self._basis.boot

    @property
    def member(self) -> Member:
        """This node under its incarnation, as the cluster's log names it."""
        return Member(self.me, self.incarnation)

    def update(self, **changes: int) -> None:
        """Change some numbers of `load`; from now on they are what we say."""
        self.load = replace(self.load, **changes)

    @property
    def fill(self) -> tuple[int, int]:
        """Bytes used, and bytes there are, as others are told (specs/13-balance.md, Fill): 0 of 0 as long as not all is known that lies here."""
        return (0, 0) if self.recovers else (self.load.disk_used_bytes, self.load.disk_total_bytes)

    @property
    def key(self) -> SigningKey:
        return self.secrets.signing

    def signed(self) -> Status:
        """A new status, signed, later than all before."""
        load = self.load
        status = replace(
            self._basis,
            lamport=self.next(),
            left_fence=_fence_before(self.arc),
            right_bound=None if self.arc is None else self.arc.last,
            log_position=self.log_position,
            blacklist=self.blacklist.prefixes,
            blacklist_version=self.blacklist.version,
            render_pool=load.render_pool,
            scene_frame=load.scene_frame,
            offline_fraction=_fraction(*self.fill),
            offline_blocks=self.fill[1] // _BLOCK_BYTES,
            online_fraction=_fraction(load.memory_used_bytes, load.memory_total_bytes),
            online_blocks=min(load.memory_total_bytes // _BLOCK_BYTES, _U32_MAX),
            rays_per_second=min(load.rays_per_second, _U32_MAX),
            ray_queue_length=min(load.ray_queue_length, _U32_MAX),
        )
        return replace(status, signature=self.secrets.signing.sign(STATUS_DOMAIN, status.signable()))

    def mini(self) -> MiniStatus:
        """The short form, for a packet on an authenticated connection.

        It names no incarnation, and others take it for the registered one's word. So before ours is that, it has the Lamport time of nobody.
        """
        load = self.load
        return MiniStatus(
            lamport=self.next() if self.is_registered else 0,
            node=self.me,
            right_bound=None if self.arc is None else self.arc.last,
            render_pool=load.render_pool,
            offline_fraction=_fraction(*self.fill),
            online_fraction=_fraction(load.memory_used_bytes, load.memory_total_bytes),
            rays_per_second=min(load.rays_per_second, _U32_MAX),
            ray_queue_length=min(load.ray_queue_length, _U32_MAX),
            log_position=self.log_position,
        )

    def may_follow(self, lamport: int) -> bool:
        """Whether a Lamport time is one of this boot that is later than all that we said, with room for more behind it."""
        return self._lamport < lamport < (self.boot << 32) + _LAST_FOLLOWED

    def follow(self, lamport: int) -> None:
        """Go on behind a Lamport time that somebody else has used in our name."""
        self._lamport = max(self._lamport, lamport)

    def next(self) -> int:
        """A number above all before, in this boot and earlier ones."""
        self._lamport += 1
        return self._lamport


def _fraction(used: int, total: int) -> int:
    """The share used, of 2^32, as 32 bits."""
    return min(used * _FRACTION_ONE // total, _U32_MAX) if total else 0


def arc_of_status(status: Status) -> Arc | None:
    """What a status claims to own; None: nothing."""
    if status.right_bound is None:
        return None
    first = FIRST if status.left_fence is None else status.left_fence.next()
    # The wire lets no fence pass that is not below the bound, so there is a place behind it.
    assert first is not None
    return Arc(first, status.right_bound)


def _fence_before(arc: Arc | None) -> Location | None:
    """The last location left of an arc; None where it begins with the line, or where there is none."""
    if arc is None or arc.first == FIRST:
        return None
    return Location.from_number(arc.first.number - 1)


def is_news(said: int, used: int) -> bool:
    """Whether a fill differs so much from what was said of it last that balance would not be found."""
    return abs(used - said) >= max(TELL_BYTES_MIN, max(used, said) * TELL_FILL)
