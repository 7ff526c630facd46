"""Reads untrusted files in a process that may crash: `python -m tests.bad_input.hostile_reader LIST.json FIRST`.

The list has pairs of kind and path. For each file, one line is printed when it has been read: its number, the outcome
("read", "refused", "bug"), the message, the peak memory of the process so far [MiB], and the processor time [s]. A file
that takes more than its limit of processor time ends the process.
"""

from __future__ import annotations

import json
import logging
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

SECONDS = 10  # processor time per file
MEMORY = 2 << 30  # bytes that reading may map beyond what the process has mapped before


def _readers() -> dict[str, Callable[[Path], object]]:
    from softprint.runtime.authoring.fill_outline import nested_loops
    from softprint.runtime.authoring.outline import read_outline
    from softprint.runtime.authoring.solid_surface import solid_surface
    from softprint.runtime.body import load_body
    from softprint.runtime.colliders.sampled.polygon import load_polygon, polygon_collider
    from softprint.runtime.colliders.surface_mesh.mesh_collider import load_mesh_collider, read_triangles
    from softprint.runtime.learned.correction_file import read_header
    from softprint.runtime.mechanics.mechanics_file import read_mechanics_header
    from softprint.runtime.mesh import read_mesh
    from softprint.runtime.scenes.motion_file import load_motion
    from softprint.runtime.truth.truth_file import load_truth
    from softprint.runtime.truth.truth_schema import TABLES
    from softprint.surrogate.checkpoints import load_checkpoint

    def truth(path: Path) -> object:
        with load_truth(path) as found:
            columns = [getattr(found, table)[name] for table, names in TABLES.items() for name in names]
            return (
                columns,
                found.usable,
                found.noise_floor,
                [found.displacement(k) for k in range(found.n_samples)],
            )

    def motion(path: Path) -> object:
        found = load_motion(path)
        return [found.positions(frame) for frame in range(found.n_frames)]

    return {
        "mesh": read_mesh,
        "surface": lambda path: load_mesh_collider(path, resolution=8),
        "solid": lambda path: solid_surface(*read_triangles(path), str(path), 100),
        "outline": lambda path: nested_loops(read_outline(path), str(path)),
        "polygon": lambda path: polygon_collider(load_polygon(path), resolution=8),
        "body": load_body,
        "truth": truth,
        "motion": motion,
        "correction": read_header,
        "mechanics": read_mechanics_header,
        "checkpoint": load_checkpoint,
    }


def main() -> None:
    from softprint.runtime.errors import SoftprintError

    files: list[tuple[str, str]] = json.loads(Path(sys.argv[1]).read_text())
    logging.disable()
    readers = _readers()
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY, mapped + MEMORY))
    for number in range(int(sys.argv[2]), len(files)):
        kind, path = files[number]
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        began = time.process_time()
        try:
            readers[kind](Path(path))
            outcome, said = "read", ""
        except SoftprintError as error:
            outcome, said = "refused", str(error)
        except BaseException:
            outcome, said = "bug", traceback.format_exc()
        signal.setitimer(signal.ITIMER_PROF, 0)
        print(json.dumps([number, outcome, said, _peak_memory(), time.process_time() - began]), flush=True)


def _peak_memory() -> int:
    """Peak memory [MiB]. Not from getrusage, which includes the memory of the process that this one was forked from."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) // 1024 for line in lines if line.startswith("VmHWM:"))


if __name__ == "__main__":
    main()
