"""Where the CPU time goes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class Stopwatch:
    """CPU seconds by label: of functions that are replaced by timed ones, and of timed blocks."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def watch(self, owner: Any, name: str, label: str) -> None:
        """Time every call of owner.name from now on; owner: an object or a class."""
        inner: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **keywords: Any) -> Any:
            with self.timed(label):
                return inner(*args, **keywords)

        setattr(owner, name, timed)

    @contextmanager
    def timed(self, label: str) -> Iterator[None]:
        start = time.process_time()
        try:
            yield
        finally:
            self.seconds[label] = self.seconds.get(label, 0.0) + time.process_time() - start
