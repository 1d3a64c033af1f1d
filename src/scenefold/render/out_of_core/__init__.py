"""Rendering within a memory budget: one process plays the nodes of all cells, and holds the trees of a few (specs/27-out-of-core.md)."""
