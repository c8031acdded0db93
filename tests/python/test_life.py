"""How long a lull.Denoiser lives, and who may use it: closing, threads, copies, forks."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import threading
import time

import numpy as np
import pytest


def test_closed(lull, frame):
    denoiser = lull.Denoiser()
    denoiser.close()
    denoiser.close()
    with pytest.raises(lull.Error, match="closed"):
        denoiser(frame["color"])


def test_threads_share_a_denoiser(lull, frame, clean):
    wrong: list[object] = []

    def work(denoiser):
        for _ in range(4):
            if not np.array_equal(denoiser(**frame), clean):
                wrong.append("other pixels")

    with lull.Denoiser(hdr=True) as one, lull.Denoiser(hdr=True, threads=1) as two:
        workers = [threading.Thread(target=work, args=(d,)) for d in (one, one, two)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    assert not wrong


def test_progress_functions_do_not_wait_for_their_own_denoiser(lull, frame, clean):
    with lull.Denoiser(hdr=True) as denoiser, lull.Denoiser(hdr=True) as other:
        for use in (lambda: denoiser.used_quality, denoiser.close, lambda: denoiser(**frame)):
            with pytest.raises(lull.Error, match="progress function"):
                denoiser(**frame, progress=lambda part, use=use: use())
        assert np.array_equal(denoiser(**frame, progress=lambda part: other(**frame)), clean)


def test_closing_waits_for_calls(lull, frame, clean):
    results: list[object] = []

    def work(denoiser):
        try:
            while True:
                results.append(denoiser(**frame))
        except Exception as err:  # also of the thread
            results.append(err)

    for _ in range(5):
        denoiser = lull.Denoiser(hdr=True)
        workers = [threading.Thread(target=work, args=(denoiser,), daemon=True) for _ in range(2)]
        for worker in workers:
            worker.start()
        while not results:
            time.sleep(0.001)
        denoiser.close()
        for worker in workers:
            worker.join(60)
            assert not worker.is_alive()
        errors = [r for r in results if isinstance(r, Exception)]
        assert [str(e) for e in errors] == ["the denoiser is closed"] * 2
        assert all(np.array_equal(r, clean) for r in results if isinstance(r, np.ndarray))
        results.clear()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_denoisers_cannot_be_copied(lull, copied):
    with lull.Denoiser() as denoiser, pytest.raises(TypeError, match="Denoiser"):
        copied(denoiser)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="optional: no fork here")
def test_children_of_a_fork(library, root):
    """In a process of its own, whose threads are lull's alone."""
    code = ("import os, sys, numpy as np, lull\n"
            "a = np.random.default_rng(1).random((200, 200, 3)).astype('f4')\n"
            "mine = lull.Denoiser(hdr=True); r = mine(a); lull.denoise(a, hdr=True)\n"
            "pid = os.fork()\n"
            "if not pid:\n"
            "    ok = np.array_equal(lull.denoise(a, hdr=True), r)\n"
            "    try: mine(a); ok = False\n"
            "    except lull.Error: pass\n"
            "    sys.exit(0 if ok else 5)\n"
            "sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          env={**os.environ, "PYTHONPATH": str(root / "python"),
                               "LULL_LIBRARY": str(library)})
    assert done.returncode == 0, done.stderr
