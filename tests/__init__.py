"""Tests of lull. tests/run.py runs them; tests/rules/ holds the rules of the tree."""
