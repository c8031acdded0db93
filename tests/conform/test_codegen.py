"""The hot loops of the ports keep their sums in registers: inside an innermost loop that
multiplies, no compiler's code may move a vector between a register and the stack, or store anything
there. (One address read from it costs nothing beside a tile of products.) Compiles the ports with
every compiler found and reads the disassembly."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
SOURCES = (ROOT / "ports" / "sources.mk").read_text().replace("\\\n", " ")
BASE = ["-std=c99", "-ffp-contract=off", "-fPIC", "-fno-stack-protector", "-Ilib"]
# What only a hot loop does.
MULTIPLY = re.compile(r"\s(vfmadd\w+ps|v?pmadd\w+|mulps|vpdp\w+|fmla|vmla\.f32|smull2?|smlal2?|"
                      r"vmlal\.s\d+|sdot|usdot|sudot|usmmla)\s")
WORDS = re.compile(r"\sv?paddw\s")  # sums of words
TILES = re.compile(r"\stdp\w+\s")  # AMX: sums pass through a buffer behind the loops, on purpose
# How many loops may, of which release on: clang 19 keeps one of twelve sums in memory, beside two
# vectors of weights, pixels and a product, for which 16 registers are just enough; clang 21 makes
# vectors of a loop over the few products that are left over (int3_rest), two too many; gcc 16 keeps
# one of the 24 sums of two loops in memory, a load and a store for 72 products.
SPILLING = {("clang", "conv_int_sse41"): (19, 1), ("clang", "conv_int_avxvnni"): (21, 1),
            ("gcc", "conv_int_vnni"): (16, 2)}
JUMP = re.compile(r"^\s*([0-9a-f]+):\s+(?:j\w+|b(?:\.\w+|[a-z]{2}(?:\.n|\.w)?)?|cbn?z|tbn?z)\s+"
                  r"(?:\w+,\s*(?:#\d+,\s*)?)?([0-9a-f]+)\s+<")
LINE = re.compile(r"^\s*([0-9a-f]+):\t")
SCALAR_READ = re.compile(r":\s+(mov\s+[^%]*\(.*\),%[re]|cmp\s|ldr\w*\s+[xwr]\d)")
ALWAYS = re.compile(r":\s+(jmp|b|b\.n|b\.w)\s")  # jumps that always do
END = re.compile(r":\s+(ret|jmp|bx\s|pop.*\bpc\b|ldmia.*\bpc\b|ldr\w*\.?w?\s+pc)")


@dataclass(frozen=True)
class Target:
    """A compiler and the groups of ports that it can build."""

    name: str
    compiler: str
    objdump: str
    arch: str


def targets() -> list[Target]:
    machine = os.uname().machine
    native = {"x86_64": "x86", "aarch64": "arm64"}.get(machine)
    found = []
    if native:
        found += [Target(cc, cc, "objdump", native) for cc in ("gcc", "clang")]
    if native != "arm64":
        cross = "aarch64-linux-gnu-"
        found.append(Target("aarch64", cross + "gcc", cross + "objdump", "arm64"))
    cross = "arm-linux-gnueabihf-"
    found.append(Target("armhf", cross + "gcc", cross + "objdump", "arm32"))
    return found


def setting(name: str) -> list[str]:
    match = re.search(rf"^{name} :=(.*)$", SOURCES, re.MULTILINE)
    return match[1].split() if match else []


def may_spill(target: Target, source: str) -> int:
    """How many loops of a source file may."""
    since, loops = SPILLING.get((target.name, Path(source).stem), (0, 0))
    if not loops:
        return 0
    release = subprocess.run([target.compiler, "-dumpversion"], capture_output=True, text=True,
                             check=True).stdout
    return loops if int(release.split(".")[0]) >= since else 0


def groups(arch: str) -> list[str]:
    return [g for g in setting("PORT_GROUPS") if arch in setting(f"PORT_{g}_ARCH")
            and setting(f"PORT_{g}_SOURCES")]


def convolutions() -> list[tuple[Target, str, str]]:
    """(target, group, source) of everything to compile."""
    return [(t, g, s) for t in targets() for g in groups(t.arch)
            for s in setting(f"PORT_{g}_SOURCES") if "/conv_" in s]


@dataclass
class Block:
    """Consecutive instructions entered at the first and left after the last."""

    lines: list[str]
    next: list[int]


def blocks_of(lines: list[tuple[int, str]]) -> dict[int, Block]:
    """Control flow of one function: blocks by address."""
    jumps = {at: int(m[2], 16) for at, line in lines if (m := JUMP.match(line))}
    inside = {at for at, _ in lines}
    starts = {lines[0][0]} | {t for t in jumps.values() if t in inside}
    blocks: dict[int, Block] = {}
    current = lines[0][0]
    for i, (at, line) in enumerate(lines):
        if at in starts and at != current:
            blocks[current].next.append(at)
            current = at
        blocks.setdefault(current, Block([], [])).lines.append(line)
        if at in jumps or END.search(line):
            block = blocks[current]
            if jumps.get(at) in inside:
                block.next.append(jumps[at])
            if i + 1 < len(lines):
                current = lines[i + 1][0]
                blocks.setdefault(current, Block([], []))
                if at in jumps and not ALWAYS.search(line):
                    block.next.append(current)
    return blocks


def reachable(blocks: dict[int, Block], start: int, without: int | None) -> set[int]:
    seen, todo = set(), [start]
    while todo:
        at = todo.pop()
        if at not in seen and at != without:
            seen.add(at)
            todo += blocks[at].next
    return seen


def natural_loops(blocks: dict[int, Block], entry: int) -> list[set[int]]:
    """Blocks of each loop: of a jump back to a block that every way to the jump passes."""
    before: dict[int, list[int]] = {at: [] for at in blocks}
    for at, block in blocks.items():
        for to in block.next:
            before[to].append(at)
    loops: dict[int, set[int]] = {}
    alive = reachable(blocks, entry, None)
    for head in blocks:
        free = reachable(blocks, entry, head)
        for tail in before[head]:
            if tail in free or tail not in alive:
                continue
            body, todo = loops.setdefault(head, {head}), [tail]
            while todo:
                at = todo.pop()
                if at not in body:
                    body.add(at)
                    todo += before[at]
    return list(loops.values())


def inner_loops(assembly: str, arch: str) -> list[tuple[list[str], re.Pattern[str]]]:
    """The instructions of every loop that contains no other, and how its function's stack is named.
    """
    found = []
    for function in re.split(r"\n\n[0-9a-f]+ <", assembly)[1:]:
        stack = re.compile(stack_registers(function, arch))
        lines = [(int(m[1], 16), line) for line in function.splitlines() if (m := LINE.match(line))]
        blocks = blocks_of(lines)
        loops = natural_loops(blocks, lines[0][0])
        found += [([line for at in sorted(loop) for line in blocks[at].lines], stack)
                  for loop in loops if not any(other < loop for other in loops)]
    return found


def stack_registers(function: str, arch: str) -> str:
    """Pattern of a memory operand in the stack frame of a function."""
    if arch != "x86":
        return r"\[(sp|x29|r11|r7)\b" if "x29, sp" in function else r"\[sp\b"
    return r"\(%rsp|\(%esp" + (r"|\(%rbp" if "%rsp,%rbp" in function else "")


def harmless(lines: list[str]) -> bool:
    """Lines with stack operands: none, or one that reads a general register or compares with it."""
    return not lines or len(lines) == 1 and bool(SCALAR_READ.search(lines[0]))


@pytest.mark.parametrize("optimisation", ["-O2", "-O3"])
@pytest.mark.parametrize(("target", "group", "source"), convolutions(),
                         ids=lambda v: v.name if isinstance(v, Target) else Path(v).stem)
def test_hot_loops_keep_off_the_stack(target: Target, group: str, source: str, optimisation: str,
                                      tmp_path: Path):
    for tool in (target.compiler, target.objdump):
        if not shutil.which(tool):
            pytest.skip(f"optional: {tool} is not installed")
    flags = setting(f"PORT_{group}_FLAGS") + setting(f"PORT_{group}_FLAGS_{target.arch}")
    done = tmp_path / "port.o"
    built = subprocess.run([target.compiler, *BASE, optimisation, *flags, "-c", source, "-o", done],
                           cwd=ROOT, capture_output=True, text=True)
    if "unrecognized" in built.stderr or "unsupported" in built.stderr:
        pytest.skip(f"optional: {target.compiler} lacks {' '.join(flags)}")
    assert built.returncode == 0, built.stderr
    text = subprocess.run([target.objdump, "-d", "--no-show-raw-insn", done], capture_output=True,
                          text=True, check=True).stdout
    multiply = TILES if source.endswith("conv_int_amx.c") else MULTIPLY
    hot = [(loop, stack) for loop, stack in inner_loops(text, target.arch)
           if any(multiply.search(line) for line in loop)]
    assert len(hot) >= 3, "found no loops: has the disassembly changed its form?"
    if "DOT_WORDS(" in (ROOT / source).read_text():  # of both shapes or more
        assert sum(any(WORDS.search(line) for line in loop) for loop, _ in hot) >= 2
    bad = [loop for loop, stack in hot
           if not harmless([line for line in loop if stack.search(line)])]
    assert len(bad) <= may_spill(target, source), "\n\n".join("\n".join(loop) for loop in bad)


def test_clang_gets_no_names_of_parts_of_registers():
    """Clang 18 and later print wrong ones for %t: what they were given did not assemble."""
    if not shutil.which("clang") or os.uname().machine != "x86_64":
        pytest.skip("optional: no clang for x86 is installed")
    for group in groups("x86"):
        for source in setting(f"PORT_{group}_SOURCES"):
            text = subprocess.run(["clang", *BASE, *setting(f"PORT_{group}_FLAGS"), "-E", source],
                                  cwd=ROOT, capture_output=True, text=True, check=True).stdout
            assert "lull_" in text and not re.search(r'__asm__\w* ?\("[^"]*%[a-z]\d', text), source
