"""Numbered, acknowledged packets between two nodes of a job (specs/30-ray-links.md)."""
