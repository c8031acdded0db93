"""Tests of OpenCL devices."""
