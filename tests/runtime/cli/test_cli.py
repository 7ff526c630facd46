"""The command line: finding verbs, reading options, error messages, and ending all ranks together."""

from __future__ import annotations

import argparse
import io
import logging
import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from importlib.util import find_spec

import pytest

from softprint.runtime.cli import discover, main
from softprint.runtime.cli import progress as progress_module
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.progress import Progress, Stage, print_beside_bars
from softprint.runtime.cli.verb import Verb
from softprint.runtime.errors import SoftprintError
from tests.conftest import REPOSITORY

WORDS = {"seen": None}


def run_toy(options: argparse.Namespace, context: Context) -> int:
    WORDS["seen"] = (options, context)
    if options.fail == "people":
        raise SoftprintError("the jelly is too sweet; take less sugar")
    if options.fail == "bug":
        raise ZeroDivisionError("a bug")
    if options.fail == "stop":
        raise KeyboardInterrupt
    if options.fail == "stop in C":  # as Python reports what is raised within a compiled function
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
    if options.fail == "bug in C":
        raise SystemError("returned NULL without setting an exception")
    return 0


def configure_toy(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--fail", default="never", help="how to fail")


TOY = Verb("toy", 5, "Does 100 % of nothing.", "softprint toy x.toml", run_toy, configure=configure_toy)
LACKING = Verb(
    "lacking", 7, "Needs the moon.", "softprint lacking", run_toy, needs=("moon_cheese", "argparse")
)


@dataclass(frozen=True)
class Point:
    """An entry point that returns a verb of this file."""

    name: str
    module: str
    verb: Verb | None = None

    def load(self) -> Verb:
        assert self.verb is not None
        return self.verb


@pytest.fixture(autouse=True)
def toy_verbs(monkeypatch):
    points = [
        Point("lacking", "softprint.runtime.cli.verb", LACKING),
        Point("toy", "softprint.runtime.cli.verb", TOY),
        Point("absent", "softprint.runtime.no_such_module"),
        Point("foreign", "no_such_package.module"),
    ]
    monkeypatch.setattr(discover, "entry_points", lambda group: points)


def test_verbs_come_in_the_order_of_the_work_and_the_missing_last():
    found = discover.find_verbs()
    assert [verb.name for verb in found] == ["toy", "lacking", "absent", "foreign"]
    assert found[1].unavailable == "needs moon_cheese"
    assert "softprint.runtime.no_such_module" in found[2].unavailable
    assert found[3].verb is None


def test_help_lists_verbs_and_what_they_lack(capsys):
    with pytest.raises(SystemExit) as ended:
        main.main(["--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert ended.value.code == 0
    assert "toy Does 100 % of nothing." in text
    assert "lacking Needs the moon. (not available here: needs moon_cheese)" in text


def test_help_of_a_verb_teaches(capsys):
    with pytest.raises(SystemExit):
        main.main(["toy", "--help"])
    text = capsys.readouterr().out
    assert "softprint toy x.toml" in text
    assert "(default: never)" in text
    for option in ("--set", "--seed", "--out", "--resume", "--no-resume", "--quiet"):
        assert option in text


def test_unavailable_verbs_say_why(capsys):
    assert main.main(["lacking", "x.toml"]) == 1
    assert capsys.readouterr().err == "softprint lacking: needs moon_cheese\n"
    assert main.main(["foreign", "x.toml", "--whatever"]) == 1
    assert "no_such_package" in capsys.readouterr().err


def test_wrong_command_lines_are_status_2(capsys):
    assert main.main([]) == 2
    for arguments in (["nonsense"], ["toy"], ["toy", "x.toml", "--seed", "many"], ["toy", "x.toml", "--out", ""]):
        with pytest.raises(SystemExit) as ended:
            main.main(arguments)
        assert ended.value.code == 2
    complaints = capsys.readouterr().err
    assert "usage: softprint" in complaints
    assert "the name of the run directory is empty" in complaints


def test_options_reach_the_verb(tmp_path):
    out = tmp_path / "run"
    assert (
        main.main(["toy", "x.toml", "--set", "a.b=1", "--seed", "5", "--out", str(out), "--no-resume"]) == 0
    )
    _, context = WORDS["seen"]
    assert context.overrides == ("a.b=1", "experiment.seed=5")
    assert not context.resume
    assert not out.exists()
    assert context.out_dir == out
    assert out.is_dir()


def test_mistakes_are_sentences_and_bugs_are_tracebacks(capsys):
    assert main.main(["toy", "x.toml", "--fail", "people"]) == 1
    assert capsys.readouterr().err == "the jelly is too sweet; take less sugar\n"
    assert main.main(["toy", "x.toml", "--fail", "people", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err
    with pytest.raises(ZeroDivisionError):
        main.main(["toy", "x.toml", "--fail", "bug"])


@pytest.mark.parametrize("where", ["stop", "stop in C"])
def test_ctrl_c_reports_that_work_is_kept(capsys, where):
    assert main.main(["toy", "x.toml", "--fail", where]) == 130
    assert "kept" in capsys.readouterr().err


def test_a_bug_in_a_compiled_function_is_no_interrupt():
    with pytest.raises(SystemError):
        main.main(["toy", "x.toml", "--fail", "bug in C"])


def test_only_the_first_rank_speaks(capsys):
    Context(rank=1).say("hello")
    assert capsys.readouterr().out == ""
    Context(rank=0).say("hello")
    assert capsys.readouterr().out == "hello\n"


def test_output_folder_that_cannot_be(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SoftprintError, match="cannot make the output folder"):
        _ = Context(out=tmp_path / "file" / "run").out_dir


def test_progress_in_a_log(caplog):
    with caplog.at_level(logging.INFO), Progress(10, unit="samples", desc="truth", quiet=True) as progress:
        progress.skip(4)
        progress.update(3, note="loss 0.5")
    assert progress.count == 7
    assert re.search(r"truth: 7/10 samples, \S+/s, \d+ s left, loss 0.5", caplog.text)


@pytest.fixture
def quick_clock(monkeypatch):
    """Lines in a log after 0.02 s."""
    for name in ("LOG_AFTER", "LOG_INTERVAL", "_TICK"):
        monkeypatch.setattr(progress_module, name, 0.02)


def wait_for(caplog, text):
    """Until the log holds a text; a thread writes it. Ten seconds are more than any busy machine needs."""
    end = time.monotonic() + 10.0
    while text not in caplog.text and time.monotonic() < end:
        time.sleep(0.01)
    assert text in caplog.text


def test_a_long_unit_of_work_is_logged(caplog, quick_clock):
    """Before the first unit has been counted, and again between two."""
    with caplog.at_level(logging.INFO), Progress(10, unit="steps", desc="full", quiet=True) as progress:
        wait_for(caplog, "full: 0/10 steps, 0 s so far")
        progress.update()
        wait_for(caplog, "full: 1/10 steps, ")
    assert not [one for one in threading.enumerate() if one.name == "progress"]


def test_a_stage_says_how_long_it_takes(caplog, quick_clock):
    with caplog.at_level(logging.INFO), Stage("factorising", quiet=True):
        wait_for(caplog, "factorising: 0 s so far")
    assert caplog.messages[-1] == "factorising: 0 s"


def test_a_quick_stage_leaves_nothing_in_a_log(caplog):
    with caplog.at_level(logging.INFO), Stage("factorising", quiet=True):
        pass
    assert caplog.text == ""


def test_progress_is_logged_where_the_rest_is_silenced():
    """`warm-up` and `verify` silence what the bodies log that they make."""
    program = (
        "import logging\n"
        "from softprint.runtime.cli import main, progress\n"
        "main._set_up_logging(0, False)\n"
        "logging.getLogger('softprint').setLevel(logging.WARNING)\n"
        "logging.getLogger('softprint.runtime.body').info('a body')\n"
        "with progress.Progress(2, 'scenes', 'kernels', quiet=True) as bar: bar.update(2)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert ran.stderr.startswith("kernels: 2/2 scenes")
    assert "a body" not in ran.stderr


def test_a_bar_on_a_terminal_ticks_and_makes_room(monkeypatch, quick_clock):
    """While a unit of work takes long the bar is drawn again; what is printed does not run into it."""

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(sys, "stdout", screen)
    with Progress(3, unit="steps", desc="full") as progress:
        drawn, end = screen.getvalue().count("0/3"), time.monotonic() + 10.0
        while screen.getvalue().count("0/3") < drawn + 2 and time.monotonic() < end:
            time.sleep(0.01)
        assert screen.getvalue().count("0/3") >= drawn + 2
        print_beside_bars("a line")
        progress.update(3)
    lines = re.split(r"[\r\n]", screen.getvalue())
    assert "a line" in lines
    assert any("3/3" in line for line in lines)


def test_progress_of_other_ranks_is_silent(caplog, capsys, quick_clock):
    with caplog.at_level(logging.INFO), Progress(10, silent=True) as progress:
        progress.update(10)
        time.sleep(0.1)
    assert caplog.text == ""
    assert capsys.readouterr().err == ""


def test_help_is_quick(softprint):
    softprint("--help")  # the first call may have to compile modules
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        assert softprint("--help").returncode == 0
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 1.0  # 0.1 to 0.2 s on an idle machine; tests share the machine with others


def test_a_bad_experiment_has_status_1_and_leaves_nothing(softprint, tmp_path):
    result = softprint("body", "gone.toml")
    if "not available" in result.stderr or "needs" in result.stderr:
        pytest.skip("the verb `body` is not available here")
    assert result.returncode == 1
    assert result.stderr == "gone.toml: there is no such experiment file\n"
    assert list(tmp_path.iterdir()) == []


ONE_RANK_FAILS = """
import sys
from mpi4py import MPI
from softprint.runtime.cli import discover, main
from softprint.runtime.cli.verb import Verb
from softprint.runtime.errors import SoftprintError

def run(options, context):
    if MPI.COMM_WORLD.rank == 1:
        raise SoftprintError("rank one found a bad mesh")
    MPI.COMM_WORLD.Barrier()  # for ever, unless the other rank ends this one
    return 0

verb = discover.FoundVerb("toy", Verb("toy", 1, "", "", run))
main.find_verbs = lambda: [verb]
sys.exit(main.main(["toy", "x.toml"]))
"""


@pytest.mark.skipif(find_spec("mpi4py") is None, reason="MPI is not installed")
def test_an_error_on_one_rank_ends_all(tmp_path):
    script = tmp_path / "one_rank_fails.py"
    script.write_text(ONE_RANK_FAILS)
    root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    result = subprocess.run(
        ["mpirun", "--oversubscribe", "-n", "2", sys.executable, script],
        env={**os.environ, **root, "PYTHONPATH": os.getcwd()},
        capture_output=True,
        text=True,
        timeout=60,  # it ends within seconds, or never
        check=False,
    )
    assert result.returncode != 0
    assert "rank 1: rank one found a bad mesh" in result.stderr


@pytest.mark.parametrize(
    ("words", "kept"), [(["toy", "x.toml"], True), (["new", "x.stl"], False), ([], False)]
)
def test_only_verbs_that_keep_work_say_so_when_they_are_stopped(words, kept):
    assert ("--no-resume" in main._stopped(words)) == kept
