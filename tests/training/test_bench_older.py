"""bench.older: frames of any size, not only those that oidnBenchmark has names for."""

from argparse import Namespace

from bench import oidn, older


def test_frames_of_any_size():
    args = Namespace(size="80x48", threads=1, isa="avx2")
    program, env = oidn.ours("oidnBenchmark"), {"LULL_PORTS": "scalar"}
    assert older.milliseconds(program, "f", args, env, 2) > 0
