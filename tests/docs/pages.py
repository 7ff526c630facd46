"""The pages of the documentation, and the parts that tests extract from them."""

from __future__ import annotations

import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
README = REPOSITORY / "README.md"
PAGES = [README, *sorted((REPOSITORY / "docs").glob("*.md"))]
_FENCE = re.compile(r"^```(\w*)[ ]*\n(.*?)^```[ ]*$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"`([^`\n]+)`")
_INDENTED = re.compile(r"(?:^\n)((?:^    .*\n)+)", re.MULTILINE)


def name(page: Path) -> str:
    """The name of a page in test ids."""
    return page.stem


def blocks(page: Path, language: str) -> list[tuple[int, str]]:
    """(line of the first line of code, code) of every fenced block of that language, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        (text.count("\n", 0, found.start(2)) + 1, found.group(2))
        for found in _FENCE.finditer(text)
        if found.group(1) == language
    ]


def commands(page: Path) -> list[str]:
    """Everything that is written as code and is not Python or TOML: fenced, indented, or inline. Lines that a backslash
    continues are one."""
    text = page.read_text(encoding="utf-8")
    fenced = [found.group(2) for found in _FENCE.finditer(text) if found.group(1) not in ("python", "toml")]
    prose = _FENCE.sub("", text)
    indented = _INDENTED.findall(prose)
    inline = [" ".join(code.split()) for code in _INLINE.findall(prose)]
    lines = "\n".join([*fenced, *indented]).replace("\\\n", " ").splitlines()
    return [line.strip() for line in [*lines, *inline] if line.strip()]
