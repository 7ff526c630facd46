"""The site that `make docs` builds: no broken links, and no resources from the network."""

from __future__ import annotations

import os
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.docs.pages import README, REPOSITORY

# Elements whose resources a browser loads by itself; an <a> is only followed by a reader.
_FETCHED = {"img", "script", "link", "iframe", "source", "video", "audio", "object", "embed", "use", "image"}
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


class _Resources(HTMLParser):
    """Collects the addresses that a page fetches."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in _FETCHED:
            self.found += [
                value for key, value in attrs if key in ("src", "href", "data", "srcset") and value
            ]


def is_remote(address: str) -> bool:
    return re.match(r"(?:[a-z]+:)?//", address) is not None


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site. The build itself fails on a broken link, a missing anchor, or a page in no menu."""
    folder = tmp_path_factory.mktemp("site") / "site"
    command = [
        str(REPOSITORY / ".venv.docs/bin/python"),
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(folder),
    ]
    built = subprocess.run(
        command,
        cwd=REPOSITORY,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def test_every_page_is_built(site: Path):
    pages = {page.stem for page in (REPOSITORY / "docs").glob("*.md")}
    assert pages <= {page.stem for page in site.glob("*.html")}


def test_the_api_is_documented(site: Path):
    text = (site / "api.html").read_text(encoding="utf-8")
    for name in ("Simulator", "load_body", "load_correction", "PenaltyContact"):
        assert f"softprint.{name}" in text
    assert "One time step." in text  # of the docstring of Simulator.step


def test_nothing_is_fetched_from_the_network(site: Path):
    for page in site.rglob("*.html"):
        resources = _Resources()
        resources.feed(page.read_text(encoding="utf-8"))
        assert resources.found, page
        assert [address for address in resources.found if is_remote(address)] == [], page
    for sheet in site.rglob("*.css"):
        text = sheet.read_text(encoding="utf-8")
        addresses = re.findall(r"url\(['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)", text)
        assert [found for pair in addresses for found in pair if found and is_remote(found)] == [], sheet


def test_a_remote_resource_would_be_found():
    resources = _Resources()
    resources.feed('<a href="https://example.org"></a><script src="https://example.org/x.js"></script>')
    assert resources.found == ["https://example.org/x.js"]
    assert is_remote(resources.found[0])
    assert is_remote("//example.org/x.js")
    assert not is_remote("assets/x.js")


def test_links_of_the_readme_lead_somewhere():
    links = [link for link in _LINK.findall(README.read_text(encoding="utf-8")) if not is_remote(link)]
    assert len(links) > 10
    assert [link for link in links if not (REPOSITORY / link.partition("#")[0]).exists()] == []
