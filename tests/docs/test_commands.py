"""Commands, paths and keys that README.md and docs/ mention exist."""

from __future__ import annotations

import argparse
import re
from functools import cache
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, README, REPOSITORY, commands, name

_OUR_PATH = re.compile(
    r"^(?:runtime|surrogate|fem_truth|examples|meshes|tests|benchmarks|reproduction|tools|docs)/[\w./-]*$"
)


@cache
def verbs() -> dict[str, argparse.ArgumentParser]:
    """The verbs of `softprint --help`, each with its parser."""
    from softprint.runtime.cli.discover import find_verbs
    from softprint.runtime.cli.main import build_parser

    parser = build_parser(find_verbs())
    (choice,) = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(choice.choices)


def called(page: Path) -> list[tuple[str, list[str]]]:
    """(verb, its arguments) of every `softprint VERB ...` on a page, without those in capitals, which are
    placeholders."""
    # What follows the program ends at a comment, or where another command begins.
    call = re.compile(r"(?:^|[ /])softprint ([a-z][\w-]*)([^#;&|]*)")
    return [(verb, rest.split()) for command in commands(page) for verb, rest in call.findall(command)]


def test_readme_is_short():
    assert len(README.read_text(encoding="utf-8").split()) <= 900


def test_commands_are_found():
    assert {"body", "generate", "train", "simulate", "report"} <= {
        verb for page in PAGES for verb, _ in called(page)
    }


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_verb_and_option_exists(page: Path):
    for verb, words in called(page):
        assert verb in verbs(), f"softprint {verb}"
        known = verbs()[verb]._option_string_actions
        for word in words:
            if word.startswith("--"):
                assert word.partition("=")[0] in known, f"softprint {verb} {word}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_script_exists(page: Path):
    text = "\n".join(commands(page))
    for module in re.findall(r"python -m ((?:benchmarks|reproduction|tools|tests)[\w.]*)", text):
        path = REPOSITORY / module.replace(".", "/")
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), module
    for script in re.findall(r"python ((?:benchmarks|reproduction|meshes|examples|tools)/[\w./]+)", text):
        assert (REPOSITORY / script).is_file(), script


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_path_exists(page: Path):
    for code in commands(page):
        for word in code.split():
            path = word.strip(",.;:()")
            if _OUR_PATH.match(path) and "*" not in path:
                assert (REPOSITORY / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_make_target_exists(page: Path):
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    for command in commands(page):
        for target in re.findall(r"^make ([a-z]+)", command):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_keys_of_experiments_exist():
    """`section.key`, alone or with a value, and what follows --set: all as `softprint keys` lists them."""
    from softprint.runtime.experiment import Experiment
    from softprint.runtime.experiment.describe import described_keys

    listed = {key for key, _, _ in described_keys(Experiment)}
    sections = "|".join(key for key in listed if "." not in key and "[" not in key)
    named = set()
    for command in (command for page in PAGES for command in commands(page)):
        named |= set(re.findall(r"--set ([a-z0-9_.]+)=", command))
        named |= set(re.findall(rf"^((?:{sections})\.[a-z0-9_.]+)(?: =.*)?$", command))
    named -= {"body.h5", "report.html", "report.json"}
    assert {"dynamics.tolerance", "sampling.places", "training.thesis5.steps"} <= named
    assert named - listed == set()
