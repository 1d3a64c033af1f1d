"""If this fails, a test of what passes over the network passes because nobody looked."""

from __future__ import annotations

import socket

import pytest

from integration import loopback_capture
from integration.loopback_capture import Capture, captured

ADDRESS = "127.0.0.2"
WORDS = b"words " * 1000
SMALL, WIDE = 4096, 64 * 1024 * 1024


def seen(count: int, buffer_bytes: int) -> Capture:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as target, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as source:
        target.bind((ADDRESS, 0))
        port = target.getsockname()[1]
        with captured(port, buffer_bytes=buffer_bytes) as capture:
            if capture.blind:
                pytest.skip(capture.blind)
            for _ in range(count):
                source.sendto(WORDS, (ADDRESS, port))
        assert capture.bytes_of("tcp", port) == 0
        assert capture.bytes_of("udp", port) + capture.dropped * len(WORDS) >= count * len(WORDS), "what was not seen was not counted"
    return capture


def test_all_that_passes_is_seen() -> None:
    capture = seen(100, WIDE)
    assert not capture.dropped and capture.found(WORDS)


def test_what_passes_unseen_is_counted() -> None:
    assert seen(1000, SMALL).dropped > 0


def test_who_may_not_look_is_told_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> socket.socket:
        raise PermissionError

    monkeypatch.setattr(loopback_capture, "_opened", refused)
    with captured(1) as capture:
        pass
    assert "only root" in capture.blind
