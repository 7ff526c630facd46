"""The formats that motions are converted to, by the ending of the file's name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from softprint.runtime.convert.colouring import NONE
from softprint.runtime.convert.film import GIF_FASTEST, FilmLook, write_gif, write_mp4
from softprint.runtime.convert.frames import SurfaceMotion, surface_motion
from softprint.runtime.convert.gltf import MOST_TARGETS, write_gltf
from softprint.runtime.convert.obj_sequence import write_obj_sequence
from softprint.runtime.convert.point_cache import write_point_cache
from softprint.runtime.convert.recorded import Recorded
from softprint.runtime.convert.sampling import Sampling
from softprint.runtime.convert.usd import write_usd
from softprint.runtime.errors import SoftprintError

Progress = Callable[[int], None]
Writer = Callable[[Path, SurfaceMotion, Progress], list[Path]]
FilmWriter = Callable[[Path, SurfaceMotion, Progress, FilmLook], list[Path]]


@dataclass(frozen=True)
class Format:
    """what: in a few words; write or film: the writer, which returns the files, of a film with its look; rate: frames a
    second where nothing is asked for, None for the motion's own; most: frames at most; fastest: frames a second at
    most; coloured: whether it holds colours; needs: a package beyond those of the runtime, with the way to install it.
    """

    what: str
    write: Writer | None = None
    film: FilmWriter | None = None
    rate: float | None = None
    most: int | None = None
    fastest: float | None = None
    coloured: bool = True
    needs: tuple[str, str] | None = None


_GLTF = Format("glTF 2.0 with morph targets", write_gltf, rate=20.0, most=MOST_TARGETS)
_USD = Format("USD with time samples", write_usd, needs=("pxr", "pip install usd-core"))
_PICTURES = ("pyvista", "pip install 'softprint[report]'")
FORMATS = {
    ".glb": _GLTF,
    ".gltf": _GLTF,
    ".usda": _USD,
    ".usdc": _USD,
    ".usdz": _USD,
    ".pc2": Format("a point cache beside an OBJ file", write_point_cache, coloured=False),
    ".obj": Format("a sequence of OBJ files", write_obj_sequence, coloured=False),
    ".gif": Format("moving pictures", film=write_gif, rate=30.0, fastest=GIF_FASTEST, needs=_PICTURES),
    ".mp4": Format("a film", film=write_mp4, rate=30.0, needs=("av", "pip install av")),
}


def find_format(out: Path) -> Format:
    """The format of a file of that name. Raises SoftprintError if there is none, or its package is missing."""
    found = FORMATS.get(out.suffix.lower())
    if found is None:
        raise SoftprintError(
            f"{out}: motions are converted to {', '.join(FORMATS)}; the ending of the name chooses"
        )
    if found.needs is not None and find_spec(found.needs[0]) is None:
        raise SoftprintError(f"{out}: {found.what} needs the package {found.needs[0]}: {found.needs[1]}")
    return found


@dataclass(frozen=True)
class Conversion:
    """A motion on its way to a file."""

    out: Path
    format: Format
    motion: SurfaceMotion
    look: FilmLook

    def write(self, progress: Progress = lambda n: None) -> list[Path]:
        """Write it, whole or not at all; progress: called with the number of frames done. Returns the files."""
        if self.format.film is not None:
            return self.format.film(self.out, self.motion, progress, self.look)
        assert self.format.write is not None
        return self.format.write(self.out, self.motion, progress)


def plan_conversion(
    source: Recorded,
    out: Path | str,
    sampling: Sampling | None = None,
    colour: str | None = None,
    with_colliders: bool = True,
    look: FilmLook | None = None,
) -> Conversion:
    """What `convert_motion` does, before it is done. colour: none by default."""
    out = Path(out)
    found, sampling = find_format(out), sampling or Sampling()
    if colour not in (None, NONE) and not found.coloured:
        raise SoftprintError(
            f"{out}: {found.what} has no colours: leave out --colour, or choose .glb or .usda"
        )
    if look is not None and look != FilmLook() and found.film is None:
        raise SoftprintError(f"{out}: {found.what} is no film: leave out --width and --cut")
    if sampling.rate is None and sampling.every is None:
        stored = sampling.times(source.times, source.label)
        length = float(stored[-1] - stored[0])
        highest = (found.most - 1) / length if found.most is not None and length > 0 else np.inf
        sampling = replace(sampling, rate=found.rate and min(found.rate, highest))
    motion = surface_motion(source, sampling, colour or NONE, with_colliders)
    if found.most is not None and len(motion) > found.most:
        raise SoftprintError(
            f"{out}: {len(motion)} frames are more than the {found.most} that players of this format can hold: choose "
            "fewer with --rate, --every, --from or --to"
        )
    if found.fastest is not None and motion.rate > 1.001 * found.fastest:
        raise SoftprintError(
            f"{out}: {motion.rate:.4g} frames a second are more than the {found.fastest:g} that players of this format "
            "show: choose fewer with --rate or --every"
        )
    return Conversion(out, found, motion, look or FilmLook())


def convert_motion(
    source: Recorded,
    out: Path | str,
    sampling: Sampling | None = None,
    colour: str | None = None,
    with_colliders: bool = True,
    look: FilmLook | None = None,
) -> list[Path]:
    """Write a motion in the format that the ending of `out` names; returns the files that were written.

    source: of `load_motion`, or a `Recording`; sampling: the frames, all by default, at the rate of the format; colour:
    displacement, pressure or none; with_colliders: whether they are in it; look: of films.

    Raises SoftprintError for an unknown ending, a missing package, frames that are not there, or a full disk.
    """
    return plan_conversion(source, out, sampling, colour, with_colliders, look).write()
