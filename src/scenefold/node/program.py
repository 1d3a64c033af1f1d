"""The program `python -m scenefold.node`: one node as a process, for a supervisor (node/local.py, systemd).

On stdout it writes events, a JSON object a line: "ready" once all ports are open, "joined" once it is a member and has heard
the others, "left" when it has left the cluster in order and ends, "failed" with what, where and remedy if it must end. Logs go
to stderr. SIGTERM and SIGINT end it in order; with --stop-with-parent the end of stdin does, too: a supervisor that dies,
however it dies, closes the pipe.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.node.logs import set_up_logs
from scenefold.node.running import run_node
from scenefold.peer import NodeContext, NodeSettings
from scenefold.peer.settings import SEED_WAIT_S, TRANSFER_BYTES_PER_S, default_data_folder, place_of, processors
from scenefold.peer.timing import REMOVE_AFTER_S
from scenefold.world import background_tasks

DONE, FAILED, WRONG_USAGE, UNREACHABLE, REFUSED = range(5)
"""Exit codes, those of scenectl."""

_log = logging.getLogger("scenefold.node")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a node as the arguments say, until told to stop; the process's exit code."""
    use_kernel_cache()
    options = _parser().parse_args(arguments)
    set_up_logs(options.log_format, options.log_level)
    try:
        trio.run(_run, _settings(options), options.stop_with_parent)
    except ScenefoldError as error:
        code = _exit_code(error)
        _log.error("%s", error)
        _tell("failed", exit_code=code, what=error.what, where=error.where, remedy=error.remedy)
        return code
    except Exception as error:  # noqa: BLE001  the last place that can tell the supervisor of a bug
        leaf = _first_leaf(error)
        _log.critical("internal error", exc_info=error)
        _tell("failed", exit_code=FAILED, what=f"internal error, {type(leaf).__name__}: {leaf}", where="", remedy="")
        return FAILED
    return DONE


async def _run(settings: NodeSettings, stop_with_parent: bool) -> None:
    async with background_tasks() as nursery:
        await nursery.start(_stop_at_signal, nursery.cancel_scope)
        if stop_with_parent:
            nursery.start_soon(_stop_at_end_of_stdin, nursery.cancel_scope)
        context = await nursery.start(_node, settings, nursery.cancel_scope)
        _tell("ready", address=context.address, node=context.me, pid=os.getpid())
        await context.joined.wait()
        _tell("joined", members=context.roster.count)
        await trio.sleep_forever()


async def _node(settings: NodeSettings, scope: trio.CancelScope, *, task_status: trio.TaskStatus[NodeContext]) -> None:
    """The node; when it has left the cluster in order, there is nothing more to do here."""
    await run_node(settings, task_status=task_status)
    _tell("left")
    scope.cancel()


async def _stop_at_signal(scope: trio.CancelScope, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
    with trio.open_signal_receiver(signal.SIGTERM, signal.SIGINT) as signals:
        task_status.started()
        async for number in signals:
            _log.info("%s: stopping", signal.Signals(number).name)
            scope.cancel()


async def _stop_at_end_of_stdin(scope: trio.CancelScope) -> None:
    async with trio.lowlevel.FdStream(os.dup(sys.stdin.fileno())) as stdin:
        async for _ in stdin:
            pass
    _log.info("the parent process has gone: stopping")
    scope.cancel()


def _tell(event: str, **details: Any) -> None:
    """One event line. Nobody may be listening, or not any more; that is no reason to fail."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.write(json.dumps({"event": event, **details}) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        _log.debug("nobody reads stdout any more")


def _first_leaf(error: BaseException) -> BaseException:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def _exit_code(error: ScenefoldError) -> int:
    match error:
        case UsageFault():
            return WRONG_USAGE
        case Unreachable():
            return UNREACHABLE
        case Refused():
            return REFUSED
        case _:
            return FAILED


def _settings(options: argparse.Namespace) -> NodeSettings:
    return NodeSettings(
        profile_folder=options.profile,
        address=options.address,
        data_folder=options.data or default_data_folder(options.profile, options.address),
        seeds=tuple(options.seed),
        seed_wait_s=options.seed_wait,
        memory_bytes=options.memory,
        capacity_bytes=options.capacity,
        render_threads=options.threads,
        remove_after_s=options.remove_after,
        transfer_bytes_per_s=options.transfer,
        blacklist=tuple(options.blacklist),
        join_place=place_of(options.join_at),
        balance=options.balance,
        log_format=options.log_format,
        log_level=options.log_level,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m scenefold.node", description="Run one node of a cluster.")
    parser.add_argument("--profile", type=Path, required=True, help="folder of the cluster profile")
    parser.add_argument("--address", required=True, help="IPv4 address of this node, a member of the cluster")
    parser.add_argument("--data", type=Path, help="folder for what the node stores")
    parser.add_argument("--seed", action="append", default=[], help="address to look for first; may be repeated")
    parser.add_argument("--seed-wait", type=float, default=SEED_WAIT_S, help="seconds until silent seeds are an error")
    parser.add_argument("--memory", type=int, default=0, help="bytes of memory to use; 0: half of the machine's")
    parser.add_argument("--capacity", type=int, default=0, help="bytes that the node may store; 0: what the disk holds")
    parser.add_argument("--remove-after", type=float, default=REMOVE_AFTER_S, help="seconds of silence before a node may be removed")
    parser.add_argument("--transfer", type=int, default=TRANSFER_BYTES_PER_S, help="bytes a second for moving data")
    parser.add_argument(
        "--blacklist",
        action="append",
        default=[],
        help="address of a node that gets no copies, or a prefix such as 10.1.2.0/24; may be repeated",
    )
    parser.add_argument("--join-at", default="loaded", help="place of a newcomer: loaded, random, or a location in hexadecimal")
    parser.add_argument("--balance", action=argparse.BooleanOptionalAction, default=True, help="move bounds to even out the load")
    parser.add_argument("--threads", type=int, default=processors(), help="threads that may render")
    parser.add_argument("--log-format", choices=("console", "json"), default="console")
    parser.add_argument("--log-level", choices=("debug", "info", "warning", "error"), default="info")
    parser.add_argument("--stop-with-parent", action="store_true", help="stop when stdin ends")
    return parser
