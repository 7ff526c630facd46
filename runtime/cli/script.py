"""How a script of benchmarks/, reproduction/, meshes/ or tools/ ends: like `softprint` itself."""

from __future__ import annotations

import sys
from collections.abc import Callable

from softprint.runtime.errors import SoftprintError


def run_script(main: Callable[[], None]) -> None:
    """Runs it. What the user can put right ends it with one sentence and status 1."""
    try:
        main()
    except SoftprintError as error:
        sys.exit(str(error))
