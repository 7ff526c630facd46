"""`make figures`: the documentation's figures are in its list, with the commands that the documentation names."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from tests.docs.pages import README, REPOSITORY, commands, name
from tools.figures import FIGURES, Figure, Records, main, named_files, shell_line

RESULTS = sorted((REPOSITORY / "docs").glob("results*.md"))
_PICTURE = re.compile(r"!\[[^\]]*\]\((?:docs/)?([\w.]+\.(?:png|gif))\)")
# Commands of README and the pages of results that make no figure.
_OTHERS = {
    "make test",
    "make docs",
    "make lint",
    "softprint verify --quick",
    "softprint bench EXPERIMENT --cores 2",
}


def plain(command: str) -> str:
    """Without a comment, and with single blanks."""
    return " ".join(command.partition(" #")[0].split())


def is_listed(command: str) -> bool:
    """Whether a figure has this command."""
    return any(stands_for(command, own) for figure in FIGURES.values() for own in figure.commands)


def stands_for(command: str, own: str) -> bool:
    """Whether a command of a page, in which capitals stand for any experiment, run directory or scene, is this one. Any
    options may follow EXPERIMENT."""
    pattern = re.escape(plain(command))
    for placeholder, any_ in (("EXPERIMENT", r"\S+"), ("RUN", r"\S+"), ("SCENE", r"\w+")):
        pattern = pattern.replace(placeholder, any_)
    return re.fullmatch(pattern + (r"( --\S.*)?" if "EXPERIMENT" in command else ""), own) is not None


def figure_commands(page: Path) -> list[str]:
    """Whole commands on a page; `softprint VERB` alone in a sentence is the verb's name and no command."""
    starts = re.compile(r"make demo|python |softprint \w+ \S|make \w+ \S")
    return [command for command in map(plain, commands(page)) if starts.match(command)]


def table_rows(page: Path) -> list[str]:
    return [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]


@pytest.mark.parametrize("page", [README, *RESULTS], ids=name)
def test_every_command_behind_a_figure_is_listed(page: Path):
    found = figure_commands(page)
    assert len(found) >= 5
    assert [command for command in found if not is_listed(command) and command not in _OTHERS] == []


def test_every_row_of_the_gallery_names_the_command_that_makes_its_picture():
    rows = [row for row in table_rows(README) if _PICTURE.search(row)]
    assert len(rows) >= 5
    for row in rows:
        (picture,) = _PICTURE.findall(row)
        makers = [figure for figure in FIGURES.values() if f"docs/{picture}" in figure.pictures]
        assert len(makers) == 1, picture
        named = [plain(code) for code in re.findall(r"`([^`]+)`", row)]
        assert set(named) & set(makers[0].commands), row


def test_every_table_of_numbers_in_the_readme_stands_under_its_command():
    text = README.read_text(encoding="utf-8").partition("## Headline figures")[2].partition("\n## ")[0]
    above = re.findall(r"((?:^(?!\||\n).*\n)+)\n\|", text, re.MULTILINE)
    assert len(above) == 2
    for sentence in above:
        assert any(is_listed(code) for code in re.findall(r"`([^`]+)`", " ".join(sentence.split()))), sentence


@pytest.mark.parametrize("figure", FIGURES.values(), ids=FIGURES)
def test_a_figure_is_where_the_list_says(figure: Figure):
    assert figure.pages
    for page in figure.pages:
        told = commands(REPOSITORY / page)
        assert any(stands_for(command, own) for command in told for own in figure.commands), page


def test_what_a_figure_needs_comes_before_it():
    seen: set[str] = set()
    for title, figure in FIGURES.items():
        assert set(figure.needs) <= seen, title
        seen.add(title)


def test_the_files_that_commands_name_exist():
    found = {
        path
        for figure in FIGURES.values()
        for line in figure.commands
        for path in named_files(line, REPOSITORY)
    }
    assert {REPOSITORY / "examples" / "hand.toml", REPOSITORY / "meshes" / "hand.vtu"} <= found
    assert {
        REPOSITORY / "benchmarks" / "bodies_speed.py",
        REPOSITORY / "meshes" / "library_sheet.py",
    } <= found
    assert [path for path in found if not path.is_file()] == []


@pytest.fixture
def records(tmp_path: Path) -> Records:
    """A figure that counts how often it was made, one that needs it, and one that fails."""
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "a.toml").write_text("")
    figures = {
        "count": Figure(("echo once >> count.txt # examples/a.toml", "wc -l < count.txt"), ("page",)),
        "picture": Figure(("echo drawn > picture.png",), ("page",), ("count",), ("picture.png",)),
        "fails": Figure(("echo before", "false", "echo after"), ("page",)),
        "late": Figure(("echo late",), ("page",), ("fails",)),
    }
    return Records(tmp_path, figures)


def test_what_is_made_is_kept_until_its_input_is_newer(records: Records, capfd: pytest.CaptureFixture[str]):
    assert records.state("picture") == "missing"
    assert main(["picture"], records) == 0
    assert [records.state(name) for name in ("count", "picture")] == ["made", "made"]
    assert "$ wc -l < count.txt\n1\n" in records.path("count").read_text()
    assert main(["picture"], records) == 0
    assert (records.root / "count.txt").read_text() == "once\n"  # nothing was run again
    later = records.path("picture").stat().st_mtime_ns + 10**9
    os.utime(records.root / "examples" / "a.toml", ns=(later, later))
    assert [records.state(name) for name in ("count", "picture")] == ["out of date", "out of date"]
    (records.root / "picture.png").unlink()
    assert records.state("picture") == "missing"


def test_again_makes_what_is_asked_for_and_not_what_it_needs(records: Records):
    assert main(["picture"], records) == 0
    made = records.path("picture").stat().st_mtime_ns
    assert main(["picture", "--again"], records) == 0
    assert records.path("picture").stat().st_mtime_ns > made
    assert (records.root / "count.txt").read_text() == "once\n"


def test_a_command_that_fails_leaves_no_record_and_stops_what_needs_it(
    records: Records, capfd: pytest.CaptureFixture[str]
):
    assert main([], records) == 1
    assert [records.state(name) for name in records.figures] == ["made", "made", "missing", "missing"]
    told = records.path("fails").with_suffix(".partial").read_text()
    assert "before" in told
    assert "\nafter" not in told
    assert "late: left out" in capfd.readouterr().err


def test_list_runs_nothing(capsys: pytest.CaptureFixture[str], records: Records):
    assert main(["--list"], records) == 0
    assert "fails: missing; page\n    echo before\n" in capsys.readouterr().out
    assert not (records.root / "runs").exists()


def test_a_name_that_is_not_listed_is_refused(capsys: pytest.CaptureFixture[str], records: Records):
    with pytest.raises(SystemExit):
        main(["nothing"], records)
    assert "there are count, picture" in capsys.readouterr().err


def test_reference_solutions_run_on_several_ranks():
    assert (
        shell_line("softprint generate x.toml", 2)
        == "OMP_NUM_THREADS=1 mpirun --oversubscribe -n 2 softprint generate x.toml"
    )
    assert shell_line("softprint generate x.toml", 1) == "softprint generate x.toml"
    assert shell_line("softprint verify", 2) == "softprint verify"


@pytest.mark.parametrize("verb", ["train", "run", "report"])
def test_training_and_reports_have_all_cores(monkeypatch, verb):
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    assert shell_line(f"softprint {verb} x.toml", 2) == f"OMP_NUM_THREADS=8 softprint {verb} x.toml"
