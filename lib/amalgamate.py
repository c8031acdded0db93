#!/usr/bin/env python3
"""Writes the core as one file, for projects that vendor C sources; `make amalgamation` calls it.

    python -m lib.amalgamate FOLDER [WEIGHTS.c]

FOLDER gets lull.c and lull.h; with what weights/embed.c made of the built-in models, lull_weights.c
and lull_weights.h, too. Files, ports and their flags are those of lib/sources.mk and
ports/sources.mk. Headers whose names all have the prefix come once, those of lib/ first and those
of a port at the start of its group; others (templates, tables, helpers of a few files) come
wherever they are included. What a source file keeps to itself gets the file's name where another
file has the same name, by a macro, and its macros end with it. Functions that lull.h does not
declare become static.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from tests.read_lists import read_lists

ROOT = Path(__file__).resolve().parent.parent
LIB = ROOT / "lib"
EVERYWHERE = "SCALAR"  # the group without a condition
# Where gcc is told flags for one architecture only; clang gets no port by these.
ARCH = {"arm32": "defined(__arm__) && !defined(__ARM_NEON)"}

DIRECTIVE = re.compile(r"\s*#\s*(\w+)\s*(.*)")
COMMENT = re.compile(r"/\*.*?\*/", re.S)
GUARD = re.compile(r"^#ifndef (LULL_\w+)\n#define \1\n", re.M)
# These speak of the flags of a file, of which there are none here.
ISA_GUARD = re.compile(r"#if (?:[^\n]*\\\n)*[^\n]*\n"
                       r"#error \"this file is compiled with[^\n]*\n#endif\n")
DEFINE = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(\w+)(?:\(([^)]*)\))?((?:[^\n]*\\\n)*[^\n]*)", re.M)
LAST = re.compile(r"^[ \t]*#[ \t]*(define|undef)[ \t]+(\w+)", re.M)
# A function or table of a file's own; such ones that a macro makes, with parts of the name pasted.
STATIC = r"(?:LULL_NOINLINE )?(?:static|LULL_INLINE)\b[^;{=()#]*?(?<![\w#])%s\s*(?:\((?!\*)|\[|=|;)"
OWN = re.compile("^" + STATIC % r"(\w+)", re.M)
MADE = re.compile(STATIC % r"(\w*##[\w#]+)")
POINTERS = re.compile(r"^static [\w *]+\(\*(?:const )?(\w+)", re.M)
TYPES = (re.compile(r"(?:struct|enum) (\w+) \{"), re.compile(r"^\} (\w+);", re.M),
         re.compile(r"^typedef [^{;([]*\b(\w+)(?:\(|;|\[)", re.M))
ENUM = re.compile(r"^(?:typedef )?enum[\w ]* \{(.*?)\}", re.M | re.S)
# Functions that headers declare, one by one or by a macro.
EXTERNAL = re.compile(r"^((?:#define \w+\([^)]*\) )?)"
                      r"((?:const )?\w+ \**lull_[\w#]+(?:\(| parameters;))", re.M)
HEAD = """/* lull {version}: denoising of Monte Carlo renders with small neural networks, one file.
 *
 * SPDX-License-Identifier: Apache-2.0
 *
 *     cc -O3 -c lull.c
 *
 * needs lull.h beside it, whose comments are the manual, and no other flags: every port that the
 * compiler knows is in, and chosen at run time. Made by `make amalgamation` from lull's sources. */
"""
TAIL = """
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC pop_options
#endif
"""
WEIGHTS = """/* The built-in models of lull {version}: weights files for lull_model_init.
 *
 * SPDX-License-Identifier: Apache-2.0 */
#ifndef LULL_WEIGHTS_H
#define LULL_WEIGHTS_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {{
#endif
{arrays}
#ifdef __cplusplus
}}
#endif

#endif
"""


@dataclass
class Unit:
    """A source file, or a shared header, with what it includes of its own."""

    name: str
    text: str = ""
    shared: list[Path] = field(default_factory=list)  # headers that it needs before
    system: list[str] = field(default_factory=list)
    names: set[str] = field(default_factory=set)  # of file scope
    macros: set[str] = field(default_factory=set)  # defined at its end


def own_names(text: str) -> set[str]:
    """Names of file scope that nobody else sees, of a text with all that it includes."""
    defined = {(m[1], m[2], m[3]) for m in DEFINE.finditer(text)}
    names = {name for pattern in (POINTERS, *TYPES) for name in pattern.findall(text)}
    for body in ENUM.findall(text):
        names |= {part.split("=")[0].strip() for part in body.split(",")} - {""}
    templates = set(OWN.findall(text)) & {macro for macro, _, _ in defined}  # called as macros say
    for macro, parameters, body in defined:
        for made in MADE.findall(body) if parameters else ():
            for call in re.findall(rf"^{macro}\(([^()]*)", text, re.M):
                values = dict(zip(parameters.replace(" ", "").split(","), re.split(r",\s*", call)))
                names.add("".join(values.get(part, part) for part in made.split("##")))
        if macro in templates and not parameters:
            names |= {word for word in body.split() if "(" not in word}
            for maker, number in re.findall(r"(\w+)\((\d)\)", body):
                names |= {b.partition("##")[0].strip() + number
                          for m, p, b in defined if m == maker and p}
    return (names | set(OWN.findall(text))) - templates


def is_guarded(path: Path) -> bool:
    return bool(GUARD.search(path.read_text()))


class Reader:
    """Reads units; finds out which headers are shared."""

    def __init__(self):
        self.shared: dict[Path, Unit | None] = {}
        self.told: set[Path] = set()  # files whose comments stand in a unit

    def share(self, path: Path) -> Unit | None:
        """A header as a unit of its own if it is a shared one."""
        if path not in self.shared:
            self.shared[path], told = None, set(self.told)
            unit = self.read(path)
            prefixed = all(n.lower().startswith("lull_") for n in unit.names | unit.macros)
            if is_guarded(path) and prefixed:
                self.shared[path] = unit
            else:
                self.told = told
        return self.shared[path]

    def read(self, path: Path) -> Unit:
        unit = Unit(path.stem)
        unit.text = self.expand(path, unit, 0, set(), {})
        bare = COMMENT.sub("", unit.text)
        unit.names = own_names(bare)
        last = {m[2]: m[1] for m in LAST.finditer(bare)}
        unit.macros = {name for name, word in last.items() if word == "define"}
        return unit

    def expand(self, path: Path, unit: Unit, depth: int, seen: set[Path], templates: dict) -> str:
        """A file with what it includes; shared and system headers go to the unit's lists, but for
        those that a source includes on a condition."""
        out = []
        depth -= is_guarded(path)
        for line in ISA_GUARD.sub("", path.read_text()).splitlines():
            match = DIRECTIVE.match(line)
            word, rest = match.groups() if match else ("", "")
            depth += word.startswith("if") - (word == "endif")
            if word == "define" and rest.startswith("TEMPLATE "):
                templates["TEMPLATE"] = rest.split()[1]
            elif word == "include":
                name = templates.get(rest, rest.partition("/*")[0].strip())
                if name[0] == '"':
                    out += self.include(path, name.strip('"'), unit, depth, seen, templates)
                elif depth and path.suffix == ".c":
                    out.append(line)
                else:
                    unit.system.append(name)
            elif (word, rest) != ("undef", "TEMPLATE"):
                out.append(line)
        return "\n".join(out) + "\n"

    def include(self, path: Path, name: str, unit: Unit, depth: int, seen: set[Path],
                templates: dict) -> list[str]:
        """Lines that stand for the inclusion of a file of ours, without comments if these stand
        somewhere already."""
        found = next(f for f in (path.parent / name, LIB / name) if f.exists()).resolve()
        if found.name == "lull.h" or found in seen:
            return []
        if self.share(found):
            unit.shared.append(found)
            return []
        if is_guarded(found) and depth == 0:
            seen.add(found)
        text = self.expand(found, unit, depth, seen, templates)
        if found in self.told:
            text = re.sub(r"\s*\n+", "\n", COMMENT.sub("", text))
        self.told.add(found)
        return text.strip().split("\n")


def region(flags: list[str], condition: str) -> tuple[str, str]:
    """Beginning and end of a part that is compiled for other instructions."""
    names = [f[2:] for f in flags if f.startswith("-m")]
    if not names:
        return "", ""
    added = [re.sub(r"^arch=[^+]*", "", name) for name in names]
    gcc = f'#pragma GCC push_options\n#pragma GCC target("{",".join(names)}")\n'
    if added != names:  # clang adds to what the file may use; gcc 12 would lack the functions
        gcc = (f"#if defined(__ARM_FEATURE_DOTPROD)\n{gcc.replace(names[0], added[0])}"
               f"#else\n{gcc}#endif\n")
    clang = ",".join(name for name in added if "=" not in name)
    macro = " LULL_AVX512" * ("avx512" in clang)
    parts = [(f'#pragma clang attribute push(__attribute__((target("{clang}"{macro}))), '
              "apply_to = function)\n", gcc),
             ("#pragma clang attribute pop\n", "#pragma GCC pop_options\n")]
    return tuple(f"#if {condition} && !defined(__clang__)\n{other}#endif\n" if condition else
                 f"#if defined(__clang__)\n{own}#else\n{other}#endif\n" for own, other in parts)


def renaming(name: str, unit: Unit) -> str:
    """The macro that gives a name its file's; of a function only where it is called if structures
    of other files have members of that name."""
    uses = re.findall(rf"(->|\.)?\b{name}\b(\()?", COMMENT.sub("", unit.text))
    is_member = any(access for access, _ in uses)
    is_called = all(call for access, call in uses if not access)
    takes, gives = ("(...)", "(__VA_ARGS__)") if is_member and is_called else ("", "")
    return f"#define {name}{takes} {name}_{unit.name}{gives}\n"


class Writer:
    """Writes the parts of lull.c one after the other."""

    def __init__(self, lists: dict[str, list[str]]):
        self.lists = lists
        self.reader = Reader()
        self.out: list[str] = []
        self.core = self.read("LIB_SOURCES")
        self.ports = {g: self.read(f"PORT_{g}_SOURCES") for g in lists["PORT_GROUPS"]}
        units = [*self.core, *(unit for units in self.ports.values() for unit in units)]
        assert len({u.name for u in units}) == len(units), "two files of one name"
        self.count = Counter(name for unit in units for name in unit.names)
        self.common = [h for h in self.headers(units) if h.parent == LIB]

    def read(self, name: str) -> list[Unit]:
        return [self.reader.read(ROOT / path) for path in self.lists[name]]

    def headers(self, units: list[Unit]) -> list[Path]:
        """Shared headers of these, each behind those that it includes."""
        found: dict[Path, None] = {}
        for unit in units:
            for path in unit.shared:
                found |= dict.fromkeys([*self.headers([self.reader.share(path)]), path])
        return list(found)

    def add_system(self, units: list[Unit], headers: list[Path]) -> None:
        units = [*map(self.reader.share, headers), *units]
        self.out += [f"#include {name}\n" for name in
                     dict.fromkeys(name for unit in units for name in unit.system)]

    def add_headers(self, headers: list[Path]) -> None:
        for path in headers:
            self.out.append(f"\n/* ==== {path.relative_to(ROOT).as_posix()} ==== */\n")
            self.out.append(EXTERNAL.sub(r"\1static \2", self.reader.share(path).text))

    def add_sources(self, units: list[Unit]) -> None:
        for unit in units:
            names = sorted(name for name in unit.names if self.count[name] > 1)
            text = unit.text
            for name in unit.macros & set(names):  # in one branch a macro
                text = re.sub(rf"^#define {name}\b", rf"#undef {name}\n\g<0>", text, flags=re.M)
            self.out.append(f"\n/* ==== {unit.name}.c ==== */\n")
            self.out += [renaming(name, unit) for name in names]
            self.out.append(text)
            self.out += [f"#undef {name}\n" for name in sorted({*names, *unit.macros})]

    def add_port(self, group: str) -> None:
        units, flags = self.ports[group], f"PORT_{group}_FLAGS"
        headers = [h for h in self.headers(units) if h not in self.common]
        regions = [region(self.lists.get(flags, []), "")]
        regions += [region(self.lists.get(f"{flags}_{arch}", []), ARCH[arch]) for arch in ARCH]
        self.out.append("\n" if group == EVERYWHERE else f"\n#if LULL_WITH_{group}\n")
        self.add_system(units, headers)
        self.out += [begin for begin, _ in regions]
        self.add_headers(headers)
        self.add_sources(units)
        self.out += [end for _, end in regions]
        self.out.append("" if group == EVERYWHERE else "#endif\n")

    def text(self, version: str) -> str:
        self.out = [HEAD.format(version=version), (LIB / "amalgamation.h").read_text(),
                    '\n#include "lull.h"\n']
        self.add_system(self.core, self.common)
        self.add_headers(self.common)
        self.add_sources(self.core)
        for group in self.lists["PORT_GROUPS"]:
            self.add_port(group)
        return "".join([*self.out, TAIL])


def weights_header(version: str) -> str:
    ids = re.findall(r"^BUILTIN\((\w+)", (ROOT / "weights/builtin.def").read_text(), re.M)
    return WEIGHTS.format(version=version, arrays="\n".join(
        f"extern const unsigned char lull_weights_{i}[];\nextern const size_t "
        f"lull_weights_{i}_bytes;" for i in ids))


def main() -> int:
    if len(sys.argv) not in (2, 3):
        print(__doc__, file=sys.stderr)
        return 2
    folder, header = Path(sys.argv[1]), (LIB / "lull.h").read_text()
    version = ".".join(re.findall(r"^#define LULL_VERSION_\w+ (\d+)", header, re.M))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "lull.h").write_text(header)
    (folder / "lull.c").write_text(Writer(read_lists(ROOT)).text(version))
    if len(sys.argv) == 3:
        (folder / "lull_weights.h").write_text(weights_header(version))
        shutil.copyfile(sys.argv[2], folder / "lull_weights.c")
    return 0


if __name__ == "__main__":
    sys.exit(main())
