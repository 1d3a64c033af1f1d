"""Scenefold: path-traced scenes on a handful of ordinary computers, without a master."""

__version__ = "0.1.0"
