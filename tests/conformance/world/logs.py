"""Waiting for a log line: what a service says when it notices something is often the only sign of it."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import trio


class _Listening(logging.Handler):
    def __init__(self, text: str, heard: trio.Event) -> None:
        super().__init__()
        self._text = text
        self._heard = heard

    def emit(self, record: logging.LogRecord) -> None:
        if self._text in record.getMessage():
            self._heard.set()


@asynccontextmanager
async def logged(text: str) -> AsyncIterator[None]:
    """Do something, then wait until a line with this text is logged on the Trio thread."""
    heard = trio.Event()
    listening = _Listening(text, heard)
    logging.getLogger().addHandler(listening)
    try:
        yield
        with trio.fail_after(30):
            await heard.wait()
    finally:
        logging.getLogger().removeHandler(listening)
