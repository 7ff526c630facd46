"""Work shared out among copies of this process: results in order, state that is kept, errors, and ends of all kinds."""

import os
import signal
import subprocess
import sys
import time

import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.forked_workers import ForkedWorkers, worker_count


class Counter:
    """Adds up the parts that this process is given."""

    def __init__(self):
        self.total = 0

    def __call__(self, part, progress):
        for _ in range(part):
            progress(1)
        self.total += part
        return os.getpid(), self.total


@pytest.mark.parametrize("count", [1, 2, 3])
def test_parts_are_worked_on_in_order_and_workers_remember(count):
    done = []
    with ForkedWorkers(Counter(), count) as workers:
        parts = [3, 5, 8][:count]
        first = workers.map(parts, done.append)
        second = workers.map(parts, done.append)
    assert [total for _, total in first] == parts
    assert [total for _, total in second] == [2 * part for part in parts]
    assert [process for process, _ in first] == [process for process, _ in second]
    assert len({process for process, _ in first}) == count
    assert (os.getpid() in {process for process, _ in first}) == (count == 1)
    assert sum(done) == 2 * sum(parts)


def test_fewer_parts_than_workers():
    with ForkedWorkers(Counter(), 3) as workers:
        assert [total for _, total in workers.map([4], lambda n: None)] == [4]
        assert workers.map([], lambda n: None) == []


@pytest.mark.parametrize("count", [1, 2])
def test_an_error_of_a_worker_is_raised(count):
    def work(part, progress):
        raise SoftprintError(f"part {part} is wrong")

    with ForkedWorkers(work, count) as workers, pytest.raises(SoftprintError, match=r"part [67] is wrong"):
        workers.map([6, 7][:count], lambda n: None)


def test_a_worker_that_is_killed_is_told():
    def work(part, progress):
        os.kill(os.getpid(), signal.SIGKILL)

    with ForkedWorkers(work, 2) as workers, pytest.raises(SoftprintError, match="was ended"):
        workers.map([0, 1], lambda n: None)


def test_a_result_of_many_bytes():
    with ForkedWorkers(lambda part, progress: bytes(part), 2) as workers:
        sizes = [len(found) for found in workers.map([3_000_000, 10], lambda n: None)]
    assert sizes == [3_000_000, 10]


def test_workers_at_work_are_ended():
    def work(part, progress):
        progress(1)
        time.sleep(600.0)

    class Stop(Exception):
        pass

    def stop(n):
        raise Stop

    began = time.monotonic()
    with pytest.raises(Stop), ForkedWorkers(work, 2) as workers:
        workers.map([0, 1], stop)
    assert time.monotonic() - began < 60.0


_PARENT = """
import os, time
from softprint.runtime.forked_workers import ForkedWorkers

def work(part, progress):
    return os.getpid()

workers = ForkedWorkers(work, 2)
print(*workers.map([0, 1], lambda n: None), flush=True)
time.sleep(600.0)
"""


def test_workers_end_with_their_parent():
    """However it ends: no worker holds the connections of another one open."""
    with subprocess.Popen([sys.executable, "-c", _PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(word) for word in parent.stdout.readline().split()]
        assert len(workers) == 2
        parent.kill()
    until = time.monotonic() + 30.0
    while any(map(_is_running, workers)):
        assert time.monotonic() < until, "a worker goes on without its parent"
        time.sleep(0.05)


def _is_running(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_the_environment_bounds_the_number_of_workers(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)))
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert (worker_count(20), worker_count(3), worker_count(0)) == (8, 3, 1)
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # of each worker
    assert worker_count(20) == 4
    monkeypatch.setenv("OMP_NUM_THREADS", "many")
    assert worker_count(20) == 8


def test_a_worker_has_no_workers(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)))
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with ForkedWorkers(lambda part, progress: worker_count(part), 2) as workers:
        assert workers.map([5, 6], lambda n: None) == [1, 1]
