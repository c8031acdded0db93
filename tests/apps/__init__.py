"""Tests of the programs, run as a user runs them."""
