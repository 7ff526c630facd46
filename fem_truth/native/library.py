"""Compiles the C sources of this folder for the processor at hand and loads them. A compiler is there wherever
DOLFINx is: its forms are compiled with it too, and these libraries lie in the same cache, behind the same lock."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import subprocess
import sysconfig
from functools import cache
from pathlib import Path

from fem_truth.form_cache import form_cache
from runtime.errors import SoftprintError

_FOLDER = Path(__file__).parent
# Only what leaves every result as IEEE arithmetic would have it, but for a * b + c in one rounding: whether an energy
# is finite is asked of these results.
_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")


@cache
def load_library(source: str, **macros: str | int) -> ctypes.CDLL:
    """The library of ``source`` (such as "blocks.c") with -DNAME=VALUE for each macro; compiled where it has not
    been for this source, these flags and this processor. Raises SoftprintError if the compiler is missing or fails.
    """
    path = _FOLDER / source
    compiler = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    defines = [f"-D{name}={value}" for name, value in sorted(macros.items())]
    command = [*shlex.split(compiler), *_FLAGS, *defines, str(path)]
    recipe = " ".join([path.read_text(), *command, _processor()])
    with form_cache() as folder:
        library = folder / f"{path.stem}_{hashlib.sha256(recipe.encode()).hexdigest()[:16]}.so"
        if not library.exists():
            _compile(command, library)
        return ctypes.CDLL(str(library))


def _compile(command: list[str], library: Path) -> None:
    """Under a name of its own until it is whole: a killed compiler leaves nothing that would be loaded."""
    unfinished = library.with_name(f"{library.name}.unfinished")
    try:
        done = subprocess.run(
            [*command, "-o", str(unfinished), "-lm"], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SoftprintError(f"{command[0]} could not compile {command[-1]}: {done.stderr.strip()[:500]}")
        os.replace(unfinished, library)
    except FileNotFoundError as error:
        raise SoftprintError(
            f"there is no C compiler {command[0]!r}: full-space solves need one (apt-get install gcc), or let "
            "CC name another"
        ) from error
    finally:
        unfinished.unlink(missing_ok=True)


def _processor() -> str:
    """What decides -march=native: homes are shared between machines that differ."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return " ".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
