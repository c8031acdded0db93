#!/usr/bin/env python3
"""Runs the tests and counts them. Only the standard library; `make check` prepares what it needs.

    tests/run.py --build build [--only unit,rules] [-k WORD] [--jobs N] [--budget S] [--list]

Suites are the folders of tests/. Each may hold C programs (listed in BUILD/tests.txt by make),
scripts test_*.sh, and pytest files test_*.py. C programs and scripts report with a last line
`N passed, N failed, N skipped`; a script without one counts as one test: status 0 passed, 77
skipped (its last line is the reason), anything else failed. A program that ends without counting
anything has failed.

Skips are listed with their reasons. Where the environment has CI=true, a skip fails unless its
reason starts with `optional: `. The very last line printed is `N passed, N failed, N skipped`; the
exit status is 0 if something passed and nothing failed.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
COUNTS = re.compile(r"^(\d+) passed, (\d+) failed, (\d+) skipped$")
SKIP_LINE = re.compile(r"^SKIP ([^:]+): (.*)$", re.MULTILINE)
SKIPPED = 77  # exit status of a script that is skipped as a whole
OPTIONAL = "optional: "
FIRST = ("rules", "unit", "training")  # telling, and what takes longest; the others follow by name
# Other compilers and other processors, half of all the work: what --budget leaves out.
LAST = ("golden (pytest)", "test_amalgamation", "test_cross", "test_windows")


@dataclass
class Result:
    """Counts of one test program, script or folder of pytest files."""

    passed: int = 0
    failed: int = 0
    skips: list[str] = field(default_factory=list)  # "test: reason"
    output: str = ""

    def fail(self, why: str) -> Result:
        self.failed += 1
        self.output += f"\n{why}\n"
        return self


@dataclass(frozen=True)
class Job:
    suite: str
    name: str
    kind: str  # "program", "script" or "pytest"
    path: Path


def find_jobs(build: Path) -> list[Job]:
    """All tests there are, in the order in which they run."""
    jobs = []
    listed = (build / "tests.txt").read_text().split()
    suites = suite_of_programs()
    for name in listed:
        path = ROOT / name
        jobs.append(Job(suites.get(path.stem, "unit"), path.stem, "program", path))
    for path in sorted((ROOT / "tests").glob("*/test_*.sh")):
        jobs.append(Job(path.parent.name, path.stem, "script", path))
    for folder in sorted({p.parent for p in (ROOT / "tests").glob("*/test_*.py")}):
        jobs.append(Job(folder.name, f"{folder.name} (pytest)", "pytest", folder))
    order = {suite: i for i, suite in enumerate(FIRST)}
    return sorted(jobs, key=lambda j: (j.name in LAST, order.get(j.suite, len(FIRST)), j.suite))


def suite_of_programs() -> dict[str, str]:
    """C program -> folder whose sources.mk lists it."""
    suites = {}
    for path in (ROOT / "tests").glob("*/sources.mk"):
        for name in re.findall(r"^TEST_(\w+?)_SOURCES\b", path.read_text(), re.MULTILINE):
            suites[name] = path.parent.name
    return suites


class Groups:
    """The process groups that run, so that all can be stopped."""

    def __init__(self):
        self.lock = threading.Lock()
        self.pids: set[int] = set()
        self.stopped = False

    def start(self, command: list[str], env: dict[str, str]) -> subprocess.Popen:
        with self.lock:
            if self.stopped:
                raise OSError("the tests were stopped")
            process = subprocess.Popen(command, cwd=ROOT, env=env, stdin=subprocess.DEVNULL,
                                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                       errors="replace", start_new_session=True)
            self.pids.add(process.pid)
            return process

    def end(self, process: subprocess.Popen) -> None:
        with self.lock:
            self.pids.discard(process.pid)

    def stop(self) -> None:
        with self.lock:
            self.stopped = True
            for pid in self.pids:
                os.killpg(pid, signal.SIGKILL)  # with all that it has started


GROUPS = Groups()


def run_command(command: list[str], env: dict[str, str], limit: float) -> tuple[int, str]:
    """Exit status (-1: past the time limit) and everything printed."""
    try:
        process = GROUPS.start(command, env)
    except OSError as error:
        return -1, f"cannot run {command[0]}: {error}"
    try:
        output, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output, _ = process.communicate()
        return -1, f"{output}\nstopped after {limit:.0f} s"
    finally:
        GROUPS.end(process)
    return process.returncode, output


def run_counted(job: Job, env: dict[str, str], limit: float) -> Result:
    """A C program or a shell script."""
    command = [str(job.path)] if job.kind == "program" else ["sh", str(job.path)]
    if job.kind == "script" and job.path.read_text().startswith("#!/usr/bin/env bash"):
        command[0] = "bash"
    status, output = run_command(command, env, limit)
    lines = output.strip().splitlines()
    last = COUNTS.match(lines[-1]) if lines else None
    result = Result(output=output)
    if last:
        result.passed, result.failed = int(last[1]), int(last[2])
        result.skips = [f"{name}: {reason}" for name, reason in SKIP_LINE.findall(output)]
        if len(result.skips) != int(last[3]):
            return result.fail(f"{int(last[3])} skips counted, {len(result.skips)} reasons given")
        if not (result.passed or result.failed or result.skips):
            return result.fail("ran no test")
        if status != 0 and not result.failed:
            return result.fail(f"exit status {status} although no test failed")
    elif job.kind == "script" and status == 0:
        result.passed = 1
    elif job.kind == "script" and status == SKIPPED:
        result.skips = [f"{job.name}: {lines[-1] if lines else 'no reason given'}"]
    else:
        return result.fail(f"exit status {status}, no closing line of counts")
    return result


def skip_reason(skip: ElementTree.Element) -> str:
    """Why pytest skipped; of a module skipped as a whole it tells only in the text."""
    whole = re.search(r"Skipped: (.*?)['\"]\)", skip.text or "")
    message = skip.get("message") or ""
    return whole[1] if message == "collection skipped" and whole else message


def run_pytest(job: Job, env: dict[str, str], limit: float, word: str) -> Result:
    """All pytest files of a folder, in one process."""
    with tempfile.TemporaryDirectory() as scratch:
        report = Path(scratch) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "--tb=short", "-p", "no:cacheprovider",
                   f"--junitxml={report}", str(job.path)]
        if word:
            command += ["-k", word]
        status, output = run_command(command, env, limit)
        result = Result(output=output)
        if word and status == 5:  # nothing of that name
            return result
        if not report.exists():
            return result.fail(f"pytest ended with status {status} and left no report")
        cases = list(ElementTree.parse(report).getroot().iter("testcase"))
    for case in cases:
        name = f"{case.get('classname')}.{case.get('name')}"
        skip = case.find("skipped")
        if case.find("failure") is not None or case.find("error") is not None:
            result.failed += 1
        elif skip is not None:
            result.skips.append(f"{name}: {skip_reason(skip)}")
        else:
            result.passed += 1
    if not cases or (status != 0 and not result.failed):
        return result.fail(f"pytest ended with status {status} after {len(cases)} tests")
    return result


def run_job(job: Job, env: dict[str, str], args: argparse.Namespace) -> tuple[Result, float]:
    """What came of a job, and the seconds that it took."""
    start = time.monotonic()
    if job.name in LAST and start > args.end:
        result = Result(skips=[f"{job.name}: {OPTIONAL}{args.budget:g} s were over before it"])
    elif job.kind == "pytest":
        result = run_pytest(job, env, args.limit, args.word)
    else:
        result = run_counted(job, env, args.limit)
    if env.get("CI") == "true":
        missing = [s for s in result.skips if OPTIONAL not in s]
        for skip in missing:
            result.fail(f"must not be skipped where CI=true: {skip}")
        result.skips = [s for s in result.skips if s not in missing]
    return result, time.monotonic() - start


def show(job: Job, result: Result, seconds: float) -> None:
    counts = f"{result.passed} passed, {result.failed} failed, {len(result.skips)} skipped"
    mark = "FAIL" if result.failed else "ok"
    print(f"{mark:4} {job.suite}/{job.name}: {counts} ({seconds:.1f} s)", flush=True)
    if result.failed:
        print("    " + result.output.strip().replace("\n", "\n    "), flush=True)
    for skip in result.skips:
        print(f"     skipped {skip}", flush=True)


def run_all(jobs: list[Job], env: dict[str, str], args: argparse.Namespace) -> Result:
    """Runs the jobs, args.jobs at once, and prints a line for each when it has ended."""
    total = Result()
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        running = {pool.submit(run_job, job, env, args): job for job in jobs}
        try:
            for future in concurrent.futures.as_completed(running):
                result, seconds = future.result()
                show(running[future], result, seconds)
                total.passed += result.passed
                total.failed += result.failed
                total.skips += result.skips
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            GROUPS.stop()
            raise
    return total


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", default="build", help="build folder (default: build)")
    parser.add_argument("--only", default="", help="suites (folders of tests/), comma separated")
    parser.add_argument("--kinds", default="program,script,pytest", help="kinds of tests to run")
    parser.add_argument("-k", dest="word", default="", help="only what has this word in its name")
    parser.add_argument("--limit", type=float, default=3600, help="seconds for one program")
    parser.add_argument("--budget", type=float, default=math.inf, metavar="S",
                        help="seconds after which no other compilers and processors are begun with")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1,
                        help="programs that run at once (default: one for each processor)")
    parser.add_argument("--list", action="store_true", help="name the programs and stop")
    args = parser.parse_args()
    args.end = time.monotonic() + args.budget

    build = (ROOT / args.build).resolve()
    if not (build / "tests.txt").exists():
        print(f"run.py: {build}/tests.txt is missing: run `make tests` first", file=sys.stderr)
        return 2
    only = {s for s in args.only.split(",") if s}
    jobs = [j for j in find_jobs(build)
            if (not only or j.suite in only) and j.kind in args.kinds.split(",")
            and (not args.word or j.kind == "pytest" or args.word in j.name)]
    if args.list:
        print("\n".join(f"{j.suite}/{j.name}" for j in jobs))
        return 0
    make = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")  # a test that runs make starts afresh
    env = {name: value for name, value in os.environ.items() if name not in make}
    env |= dict(LULL_BUILD=str(build), LULL_ROOT=str(ROOT), PYTHON=sys.executable)
    env["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), env.get("PYTHONPATH", "")]))
    env.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # several at once: no thread spins while it waits
    env.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's: its threads always spin
    total = run_all(jobs, env, args)
    print(f"{total.passed} passed, {total.failed} failed, {len(total.skips)} skipped")
    return 0 if total.passed and not total.failed else 1


if __name__ == "__main__":
    sys.exit(main())
