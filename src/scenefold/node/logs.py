"""Logs of a node process: structured, on stderr, for people or for machines.

All rooms log through the standard library, under names that begin with "scenefold"; structlog only gives the lines
their form, so that services need not know how they will be read.
"""

from __future__ import annotations

import io
import logging
import sys
from typing import Literal, TextIO

import structlog

from scenefold.base.printable import printable, printable_lines

CHARACTERS_MAX = 4_000
"""Of one value in a line."""


def _printable(_logger: object, _method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """Words of others are in what is logged, and whoever reads it may do so on a terminal."""
    return {name: printable(value, CHARACTERS_MAX) if isinstance(value, str) else value for name, value in event.items()}


def _bounded(_logger: object, _method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """JSON writes everything out that is not ASCII."""
    return {
        name: value if name == "exception" else value[:CHARACTERS_MAX] if isinstance(value, str) else value for name, value in event.items()
    }


def _traceback(stream: TextIO, found: structlog.typing.ExcInfo) -> None:
    written = io.StringIO()
    # The default shows the values of all frames' locals, and keys are among them.
    structlog.dev.plain_traceback(written, found)
    stream.write(printable_lines(written.getvalue()))


def set_up_logs(form: Literal["console", "json"], level: str) -> None:
    """Let this process log to stderr: a JSON object a line, or lines for people. For the main program only."""
    shared: list[structlog.typing.Processor] = [
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    last: list[structlog.typing.Processor]
    if form == "json":
        last = [structlog.processors.format_exc_info, _bounded, structlog.processors.JSONRenderer()]
    else:
        last = [structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty(), exception_formatter=_traceback)]
        last.insert(0, _printable)
    formatter = structlog.stdlib.ProcessorFormatter(
        foreign_pre_chain=shared, processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last]
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter)
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)
    logging.getLogger("scenefold").setLevel(level.upper())
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
    )
