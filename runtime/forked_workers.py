"""Copies of this process that share out work on its cores. Each has all that this one has loaded when it is forked, and
keeps what it computes for the next parts that it is given.

    with ForkedWorkers(work, count) as workers:
        results = workers.map(parts, progress)      # part k by worker k: work(part, progress)
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Generic, TypeVar, cast

from softprint.runtime.errors import SoftprintError
from softprint.runtime.linalg.one_thread import one_thread

Part = TypeVar("Part")
Result = TypeVar("Result")

#: Work on one part, which reports how much of it is done.
Work = Callable[[Part, Callable[[int], None]], Result]


def worker_count(parts: int) -> int:
    """As many workers as this process has cores, or OMP_NUM_THREADS, and no more than parts; one where processes cannot
    be forked, or where this one is such a worker itself. Threads of BLAS are another matter: each worker has one."""
    forks = "fork" in multiprocessing.get_all_start_methods()
    if not forks or multiprocessing.current_process().daemon:
        return 1
    cores, told = len(os.sched_getaffinity(0)), os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(cores, parts, int(told) if told.isdigit() else cores))


class ForkedWorkers(Generic[Part, Result]):
    """count workers; one is this process itself."""

    def __init__(self, work: Work[Part, Result], count: int) -> None:
        self._work, self._count = work, count
        self._processes: list[BaseProcess] = []
        self._connections: list[Connection] = []

    def map(self, parts: Sequence[Part], progress: Callable[[int], None] | None = None) -> list[Result]:
        """The results of at most as many parts as there are workers. An error of a worker is raised here."""
        told = progress or (lambda done: None)
        if self._count == 1:
            return [self._work(part, told) for part in parts]
        if not self._processes:
            self._start()
        used = self._connections[: len(parts)]
        for worker, part in enumerate(parts):
            self._send(worker, part)
        results: dict[Connection, Result] = {}
        while len(results) < len(used):
            for ready in wait([one for one in used if one not in results]):
                connection = cast("Connection[Any, Any]", ready)
                kind, content = self._received(connection)
                if kind == "done":
                    told(content)
                elif kind == "error":
                    raise content
                else:
                    results[connection] = content
        return [results[connection] for connection in used]

    def close(self) -> None:
        """End the workers, whatever they do."""
        # Killed, and before their connections are closed: of other signals PETSc, if loaded, makes an error.
        for process in self._processes:
            process.kill()
            process.join()
        for connection in self._connections:
            connection.close()
        self._processes, self._connections = [], []

    def __enter__(self) -> ForkedWorkers[Part, Result]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start(self) -> None:
        forked = multiprocessing.get_context("fork")
        for _ in range(self._count):
            ours, theirs = forked.Pipe()
            self._connections.append(ours)
            process = forked.Process(target=self._serve, args=(theirs,), daemon=True)
            process.start()
            theirs.close()
            self._processes.append(process)

    def _send(self, worker: int, part: Part) -> None:
        # Checked first: writing to a closed pipe raises a signal, and PETSc, if loaded, ends this process on it.
        if not self._processes[worker].is_alive():
            raise SoftprintError(_ENDED)
        try:
            self._connections[worker].send(part)
        except ConnectionError:
            raise SoftprintError(_ENDED) from None

    def _received(self, connection: Connection) -> tuple[str, Any]:
        try:
            kind, content = connection.recv()
        except (EOFError, ConnectionError):
            raise SoftprintError(_ENDED) from None
        return kind, content

    def _serve(self, connection: Connection) -> None:
        """A worker, until its parent has ended or closes the connection. Those of the parent are closed here: a worker
        that holds them open would not let the others see its end."""
        for other in self._connections:
            other.close()
        # The end of the parent, of which PETSc would make an error.
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        one_thread()

        def tell(kind: str, content: object) -> None:
            connection.send((kind, content))

        with suppress(EOFError, ConnectionError, KeyboardInterrupt):
            while True:
                part = connection.recv()
                try:
                    result = self._work(part, lambda n: tell("done", n))
                except Exception as error:
                    tell("error", error)
                else:
                    tell("result", result)


_ENDED = "a process that shared the work was ended, perhaps for lack of memory: run the same command again"
