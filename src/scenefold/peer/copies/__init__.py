"""Copies: which nodes hold what, when a write counts, and how configurations change (thesis B.3.4, Algorithm 7; specs/20-copies.md)."""
