"""Who may include whom (docs/design.md, section 5)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.rules.sources import files_of, name_of

# A file that a template's user names by #define TEMPLATE counts as included there.
INCLUDE = re.compile(r'^[ \t]*#[ \t]*(?:include|define[ \t]+TEMPLATE)[ \t]*(["<])([^">]+)[">]',
                     re.MULTILINE)

# What a module of lib/ (its .c and .h) may include beside its own header, base.h and lull.h.
LIB = {
    "amalgamation": set(),
    "base": set(),
    "lull": set(),
    "status": set(),
    "tza": {"image"},
    "pixels": set(),
    "image": {"pixels"},
    "transfer": {"curves"},
    "curves": {"kernels"},
    "exposure": {"image", "transfer", "kernels"},
    "fill": {"image"},
    "cpu": {"ports"},
    "winograd": set(),
    "patches": set(),
    "bilateral": {"pixels"},
    "kernels": {"bilateral", "patches", "ports", "winograd"},
    "dispatch": {"kernels", "cpu", "ports"},
    "graph": {"bilateral", "tza", "nets", "patches", "winograd"},
    "pack": {"graph", "kernels", "transfer"},
    "plan": {"pack", "exposure"},
    "filter": {"pack", "transfer"},
    "exec": {"plan", "filter", "image", "transfer", "exposure"},
    "nets": set(),
    "ports": set(),
    "nlm": {"image", "transfer"},
}
LIBC = {"float.h", "stddef.h", "stdint.h", "string.h"}  # string.h in base.h only
INTRINSICS = {"immintrin.h", "emmintrin.h", "tmmintrin.h", "arm_neon.h", "wasm_simd128.h",
              "cpuid.h"}
PORT_MAY = {"base", "curves", "kernels", "lull", "patches", "pixels", "winograd"}  # headers of lib/
APPS_MAY = {"lull.h", "OpenImageDenoise/oidn.h", "OpenImageDenoise/oidn.hpp",
            "OpenImageDenoise/config.h", "OpenImageDenoise/lull_quality.h", "builtin.def"}


def includes(path: Path) -> list[tuple[bool, str]]:
    """(is quoted, name) of every include line."""
    return [(quote == '"', name) for quote, name in INCLUDE.findall(path.read_text())]


def stem(name: str) -> str:
    return Path(name).stem


def all_of(folder: str) -> list[Path]:
    files = files_of(folder, suffixes=(".c", ".h", ".def", ".inc"))
    assert files or folder == "bench", f"{folder}/ holds no C files"
    return files


def test_lib_includes_only_what_its_module_may():
    wrong = []
    for path in all_of("lib"):
        module = path.stem.split("_")[0]  # exec_u.c is a part of exec
        allowed = LIB.get(module)
        if allowed is None:
            wrong.append(f"{name_of(path)}: module '{module}' has no row in {Path(__file__).name}")
            continue
        for quoted, name in includes(path):
            own = stem(name).split("_")[0]
            if quoted and own not in allowed | {"base", "lull", module}:
                wrong.append(f"{name_of(path)} includes {name}")
            elif not quoted and name not in LIBC | (INTRINSICS if module == "cpu" else set()):
                wrong.append(f"{name_of(path)} includes <{name}>")
    assert not wrong, "\n".join(wrong)


def test_ports_include_kernels_their_own_folder_and_templates():
    wrong = []
    for path in all_of("ports"):
        own = {p.name for p in path.parent.iterdir()}
        own |= {f"../{p.name}" for p in path.parent.parent.glob("*_rows.h")}  # of all ports
        for quoted, name in includes(path):
            if quoted and stem(name) not in PORT_MAY and name not in own:
                wrong.append(f"{name_of(path)} includes {name}")
            elif not quoted and name not in LIBC | INTRINSICS:
                wrong.append(f"{name_of(path)} includes <{name}>")
    assert not wrong, "\n".join(wrong)


def test_includes_have_names():
    """Those by way of a macro are seen by the other tests where TEMPLATE is defined, only."""
    computed = re.compile(r'^[ \t]*#[ \t]*include[ \t]+([^"< \t\n].*)$', re.MULTILINE)
    wrong = [f"{name_of(path)} includes {what}" for folder in ("lib", "ports", "oidn", "apps")
             for path in all_of(folder) for what in computed.findall(path.read_text())
             if what != "TEMPLATE"]
    assert not wrong, "\n".join(wrong)


def test_facade_includes_lib_headers_and_itself():
    own = {p.name for p in files_of("oidn", "lib", "ports/opencl", suffixes=(".h", ".def", ".hpp"))}
    wrong = [f"{name_of(path)} includes {name}" for path in all_of("oidn")
             for quoted, name in includes(path)
             if quoted and Path(name).name not in own | {"builtin.def", "builtin.h"}]
    assert not wrong, "\n".join(wrong)


def test_apps_include_public_headers_and_themselves():
    own = {p.name for p in files_of("apps", suffixes=(".h", ".def", ".inc"))}
    wrong = [f"{name_of(path)} includes {name}" for path in all_of("apps")
             for quoted, name in includes(path) if quoted and name not in own | APPS_MAY]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("folder", ["lib", "ports", "oidn"])
def test_nobody_includes_facade_apps_or_tests(folder: str):
    facade = "" if folder == "oidn" else "|oidn|OpenImage"
    forbidden = re.compile(r"(^|/)(apps|tests|bench)/" + facade)
    wrong = [f"{name_of(path)} includes {name}" for path in all_of(folder)
             for _, name in includes(path) if forbidden.search(name)]
    assert not wrong, "\n".join(wrong)


def test_extensions_live_in_base_h():
    """__attribute__ and __builtin only in base.h; ports may use what their CPU needs."""
    extension = re.compile(r"__(attribute|builtin)")
    wrong = [name_of(p) for p in all_of("lib")
             if p.name not in ("base.h", "cpu.c") and extension.search(p.read_text())]
    assert not wrong, "\n".join(wrong)
