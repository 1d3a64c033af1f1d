"""What a node holds of renders while they are under way, and what is left of them afterwards, beside what it may (specs/30-ray-links.md, Bounds)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from scenefold.render.pool.links import sender
from scenefold.render.pool.links.link import Link
from scenefold.render.pool.links.receiver import WINDOW
from scenefold.render.pool.member import Member
from scenefold.render.pool.own_passes import passes_in_flight, rays_of_a_path
from scenefold.render.pool.service import RenderService


def beyond(services: Mapping[int, RenderService]) -> Iterator[tuple[int, str]]:
    """Slots, and what their nodes hold that is more than they may."""
    waiting: dict[tuple[int, int], int] = {}
    for slot, service in services.items():
        for job, part in service._parts.jobs():
            member = part._member
            if member is None:
                continue
            attempt, nodes = (job, member._roster.attempt), len(member._roster.nodes)
            in_flight = passes_in_flight(nodes)
            rays_max = nodes * in_flight * part.job.plan.size(0) * rays_of_a_path(part.job.depth)
            waiting[attempt] = waiting.get(attempt, 0) + _waiting(member)
            if waiting[attempt] > rays_max:
                yield slot, f"{waiting[attempt]} rays wait in one attempt, and there may be {rays_max}"
            own = member._own
            if len(own.ledgers) > in_flight or len(own.ledgers) + len(own._untold) > 2 * in_flight:
                yield slot, f"{len(own.ledgers)} passes are open, and {len(own._untold)} are not known to all to be closed"
            if len(member._sums) > 2 * in_flight * nodes:
                yield slot, f"there are sums of {len(member._sums)} passes, and may be of {2 * in_flight * nodes}"
            for place, link in member._links.items():
                yield from ((slot, f"the link to place {place}: {what}") for what in _beyond_credit(link))


def _waiting(member: Member) -> int:
    astray = sum(len(work.rays) for work in member._astray)
    return len(member._queue) + astray + sum(link._outbox._waiting for link in member._links.values())


def _beyond_credit(link: Link) -> Iterator[str]:
    under_way = link._sender._under_way
    held = sum(one.size for one in under_way.values())
    if held != link._sender.bytes_under_way:
        yield f"{held} bytes are under way, and {link._sender.bytes_under_way} are counted"
    if held > sender.BYTES_MAX and len(under_way) > 1:
        yield f"{held} bytes are under way, and {sender.BYTES_MAX} may be"
    if under_way and max(under_way) - min(under_way) >= WINDOW:
        yield f"numbers {min(under_way)} to {max(under_way)} are under way"


def left_of_jobs(services: Mapping[int, RenderService]) -> Iterator[tuple[int, str]]:
    """Slots, and which jobs their nodes know of."""
    for slot, service in services.items():
        for job, part in service._parts.jobs():
            yield slot, f"takes part in job {job:016x}, {part.phase.value}"
        for job, organiser in service._organisers.jobs():
            yield slot, f"organises job {job:016x}, {organiser._phase}"
