"""How scripts end."""

import pytest

from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError


def test_what_the_user_can_put_right_is_one_sentence():
    def wrong():
        raise SoftprintError("runs/jelly: has no truth: `softprint generate` makes it")

    with pytest.raises(SystemExit, match="has no truth") as ended:
        run_script(wrong)
    assert isinstance(ended.value.code, str)  # printed to stderr, with status 1


def test_a_bug_stays_a_traceback():
    with pytest.raises(ZeroDivisionError):
        run_script(lambda: 1 / 0)
