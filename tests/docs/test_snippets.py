"""Every snippet of Python in README.md and docs/ runs."""

from __future__ import annotations

import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, README, REPOSITORY, blocks, name

WITH_SNIPPETS = [page for page in PAGES if blocks(page, "python")]


def test_there_are_snippets():
    """If the pattern that finds them were wrong, the tests below would be empty and pass."""
    assert README in WITH_SNIPPETS
    assert len(WITH_SNIPPETS) >= 3


@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=name)
def test_snippets_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The blocks of a page one after the other, as a reader would type them into one session, beside a copy of the
    repository's examples and meshes."""
    if "<!-- needs: dolfinx -->" in page.read_text(encoding="utf-8") and find_spec("dolfinx") is None:
        pytest.skip("the snippets of this page need DOLFINx")
    for folder in ("examples", "meshes"):
        (tmp_path / folder).symlink_to(REPOSITORY / folder)
    monkeypatch.chdir(tmp_path)
    script = ""
    for line, code in blocks(page, "python"):
        # Blank lines in front make the line numbers of a traceback those of the page.
        script += "\n" * (line - 1 - script.count("\n")) + code
    path = tmp_path / f"{page.stem}.py"
    path.write_text(script)
    runpy.run_path(str(path), run_name="__main__")


def test_the_blocks_of_an_experiment_file_make_one_that_is_valid(tmp_path: Path):
    from softprint.runtime.experiment import load_experiment

    page = REPOSITORY / "docs" / "experiment_files.md"
    (tmp_path / "examples").mkdir()
    (tmp_path / "meshes").symlink_to(REPOSITORY / "meshes")
    path = tmp_path / "examples" / "my_jelly.toml"
    path.write_text("\n".join(code for _, code in blocks(page, "toml")))
    experiment = load_experiment(path)
    assert experiment.dim == 3
    assert [scene.role for scene in experiment.scenes] == ["record", "test"]
