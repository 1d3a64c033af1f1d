"""What the fuzzer looks for."""

from __future__ import annotations


class Finding(Exception):
    """A law that did not hold."""
