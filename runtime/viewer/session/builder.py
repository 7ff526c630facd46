"""Makes models on a thread of its own, so that the simulation goes on meanwhile."""

from __future__ import annotations

import logging
from concurrent.futures import Future, ThreadPoolExecutor

from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.session.workshop import Model, Plan, Workshop

log = logging.getLogger(__name__)


class Builder:
    """Makes the models of the newest request; an older one that is not finished is dropped."""

    def __init__(self, workshop: Workshop) -> None:
        self._workshop = workshop
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="builder")
        self._wanted: Future[list[Model]] | None = None
        self.what = ""

    @property
    def busy(self) -> bool:
        """Whether a request has not been fetched."""
        return self._wanted is not None

    def ask(self, plans: list[Plan], what: str) -> None:
        """Begin to make the models of these plans; what: for the user."""
        if self._wanted is not None:
            self._wanted.cancel()
        self.what = what
        self._wanted = self._pool.submit(lambda: [self._workshop.make(plan) for plan in plans])

    def fetch(self, wait: bool = False) -> list[Model] | None:
        """The finished models, once; None while there are none. Raises SoftprintError where they cannot be made."""
        if self._wanted is None or not (wait or self._wanted.done()):
            return None
        wanted, self._wanted, self.what = self._wanted, None, ""
        try:
            return wanted.result()
        except SoftprintError:
            raise
        except Exception as error:
            log.debug("making a model failed", exc_info=True)
            raise SoftprintError(f"it cannot be made: {type(error).__name__}: {error}") from error

    def close(self) -> None:
        """End the thread; what is being made is not waited for."""
        self._pool.shutdown(wait=False, cancel_futures=True)
