"""What the documents name is there: options, files, modules, targets, models."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import pytest

from tests.rules.sources import ROOT, name_of, tracked_files

OPTION_TABLES = {"oidnDenoise": "apps/denoise_options.c", "oidnBenchmark": "apps/oidnBenchmark.c",
                 "yimgdenoise": "apps/yimgdenoise.c", "ynlmdenoise": "apps/ynlmdenoise.c",
                 "lullInfo": "apps/lullInfo.c"}
PAGES = {name_of(p): p.read_text() for p in tracked_files() if p.suffix == ".md"}
# What was tried and left is told of there, too.
PRESENT = {name: text for name, text in PAGES.items() if name != "docs/model-history.md"}
OTHERS = re.compile(r"^Worth imitating.*?\n\n", re.M | re.S)  # a paragraph on other projects' files


def option_rows(path: str) -> list[str]:
    """A program's table of options: their spellings, without dashes."""
    rows = re.findall(r'\b(?:CALL|FLAG|TEXT|WORD|INT|FLOAT)\("([^"]+)"', (ROOT / path).read_text())
    assert rows
    return rows


def option_names(path: str) -> set[str]:
    return {name for row in option_rows(path) for name in row.split()}


@pytest.mark.parametrize("program", OPTION_TABLES)
def test_every_option_is_in_the_manual(program: str):
    """With all its aliases: in its section, or in that of the program whose options it shares."""
    parts = re.split(r"^## ", PAGES["docs/apps.md"], flags=re.MULTILINE)[1:]
    sections = dict(part.split("\n", 1) for part in parts)
    text = sections[program] + sections["oidnDenoise"] * (program == "oidnBenchmark")
    named = {word.lstrip("-") for word in re.split(r"[\s`|()\[\],;]+", text)}
    assert not option_names(OPTION_TABLES[program]) - named


@pytest.mark.parametrize("program", OPTION_TABLES)
def test_every_option_is_in_the_man_page(program: str):
    """By one of its spellings."""
    page = (ROOT / "apps" / "man" / f"{program}.1").read_text().replace("\\-", "-")
    words = re.split(r'(?:\\f.|[\s",|])+', page)
    named = {word.lstrip("-") for word in words if word.startswith("-")}
    rows = option_rows(OPTION_TABLES[program])
    assert not [row for row in rows if not named.intersection(row.split())]


def anchors(text: str) -> set[str]:
    """What links may name of a page: its headings as GitHub writes them."""
    names = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", name.lower()).replace(" ", "-") for name in names}


def test_links_lead_somewhere():
    dead = []
    for page, text in PAGES.items():
        for link in re.findall(r"\]\(([^):\s]+)\)", text):
            path, _, section = link.partition("#")
            target = (ROOT / page).parent / path if path else ROOT / page
            if not target.exists() or section and section not in anchors(target.read_text()):
                dead.append(f"{page}: {link}")
    assert not dead


def test_named_files_exist():
    files = {name_of(p) for p in tracked_files()}
    known = files | {f"{parent}/" for f in files for parent in PurePosixPath(f).parents}
    known |= {f.rstrip("/") for f in known}
    tops = {f.split("/")[0] for f in files}
    missing = [f"{page}: {name}" for page, text in PRESENT.items()
               for name in re.findall(r"`([\w.-]+/[\w./-]*)`", OTHERS.sub("", text))
               if name.split("/")[0] in tops and name not in known]
    assert not missing


def test_named_modules_exist():
    missing = {f"{page}: {module}" for page, text in PRESENT.items()
               for module in re.findall(r"(?:python -m |`)((?:training|export|bench)\.[a-z]\w*"
                                        r"(?:\.\w+)*)(?=[\s`])", text)
               if not any((ROOT / f"{module.replace('.', '/')}{end}").exists()
                          for end in (".py", "/__init__.py"))}
    assert not missing


def test_named_targets_exist():
    makefile = (ROOT / "Makefile").read_text()
    named = {page: re.findall(r"(?:`|^ {4})make\s+([a-z][\w-]*)", text, re.MULTILINE)
             for page, text in PRESENT.items()}
    assert {"demo", "check", "peer-test"} <= {*named["README.md"]}
    assert not [f"{page}: {t}" for page, targets in named.items() for t in targets
                if not re.search(rf"^{t}:", makefile, re.MULTILINE)]


def test_bytes_of_the_models():
    """In the first table of docs/models.md, every weights file and no other."""
    table = PAGES["docs/models.md"].partition("\n\n")[2].partition("\n\n## ")[0]
    told = {name: int(kb) for name, kb in
            re.findall(r"^\|.*`(\w+\.tza)` \| [\d.]+ \| (\d+) k \|", table, re.MULTILINE)}
    there = {p.name: round(p.stat().st_size / 1000) for p in tracked_files()
             if p.suffix == ".tza" and p.parent.name == "weights"}
    assert told == there
