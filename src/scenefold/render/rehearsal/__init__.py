"""Renders by several nodes in one process, in fair and foul weather: for tests and measurements."""
