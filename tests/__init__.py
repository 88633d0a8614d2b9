"""Tests of haptix; a package so that they share `tests.command_line`."""
