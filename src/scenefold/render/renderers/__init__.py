"""Renderers, each in a package of its own, found by entry point (group `scenefold.renderers`)."""
