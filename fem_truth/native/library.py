"""Compiles the C sources in this folder for this processor and loads them. DOLFINx needs a C compiler for its forms, so
there always is one. The libraries are in the same cache as the forms, protected by the same lock."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shlex
import subprocess
import sysconfig
from functools import cache
from pathlib import Path

from softprint.fem_truth.elasticity.form_cache import form_cache
from softprint.runtime.errors import SoftprintError

_FOLDER = Path(__file__).parent
# Only flags that keep IEEE arithmetic, except that a * b + c may be rounded once: the code tests results for being
# finite.
_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")


@cache
def load_library(source: str, **macros: str | int) -> ctypes.CDLL:
    """The library of ``source`` (such as "blocks.c") with -DNAME=VALUE for each macro. It is compiled if there is none
    in the cache for this source, its headers, these flags and this processor. Raises SoftprintError if the compiler
    is missing or fails.
    """
    path = _FOLDER / source
    compiler = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    defines = [f"-D{name}={value}" for name, value in sorted(macros.items())]
    command = [*shlex.split(compiler), *_FLAGS, *defines, str(path)]
    texts = [path.read_text(), *(header.read_text() for header in sorted(_FOLDER.glob("*.h")))]
    recipe = " ".join([*texts, *command])
    with form_cache() as folder:
        library = folder / f"{path.stem}_{hashlib.sha256(recipe.encode()).hexdigest()[:16]}.so"
        if not library.exists():
            _compile(command, library)
        return ctypes.CDLL(str(library))


def _compile(command: list[str], library: Path) -> None:
    """Compile to a temporary name and rename when complete, so that the output of a killed compiler is never loaded."""
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
            f"there is no C compiler {command[0]!r}: full-space solves need one (apt-get install gcc, or set CC to "
            "another)"
        ) from error
    finally:
        unfinished.unlink(missing_ok=True)
