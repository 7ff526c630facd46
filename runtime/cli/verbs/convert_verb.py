"""`softprint convert`: a motion as a file for other programs, or as a film."""

from __future__ import annotations

import argparse
from pathlib import Path

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The motion, the file, and which frames of it."""
    parser.add_argument("motion", type=Path, metavar="MOTION.h5", help="a motion of `softprint simulate`")
    parser.add_argument(
        "out",
        type=Path,
        metavar="OUT",
        help="the file to write; its ending chooses the format: .glb .gltf .usda .usdc .usdz .pc2 .gif .mp4, or .obj "
        "for a sequence of files OUT_0001.obj, OUT_0002.obj ...",
    )
    parser.add_argument(
        "--from",
        dest="begin",
        metavar="TIME",
        help="where to begin: seconds, as in 0.5, or a frame of the motion, as in 30f (default: its start)",
    )
    parser.add_argument("--to", dest="end", metavar="TIME", help="where to end, included (default: its end)")
    parser.add_argument(
        "--every", type=int, metavar="N", help="every Nth frame of the motion (default: all, or --rate)"
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="frames a second, interpolated (default: 30 for films, 20 for glTF, the motion's own for others)",
    )
    parser.add_argument(
        "--colour",
        choices=("none", "displacement", "pressure"),
        default="none",
        help="colour the body by displacement or contact pressure (default: none)",
    )
    parser.add_argument(
        "--width", type=int, metavar="PIXELS", help="of films (default: 640 for GIF, 1280 for MP4)"
    )
    parser.add_argument(
        "--cut",
        metavar="AXIS=VALUE",
        help="cut films of 3D bodies open at a plane, as in y=0.01 [m], and take away what is nearer to the camera",
    )
    parser.add_argument("--no-colliders", action="store_true", help="leave the colliders out (default: off)")


def run(args: argparse.Namespace, context: Context) -> int:
    """Write the files, whole or not at all."""
    from softprint.runtime.convert.film import FilmLook
    from softprint.runtime.convert.formats import find_format, plan_conversion
    from softprint.runtime.convert.sampling import Moment, Sampling
    from softprint.runtime.drawing.film.subject import Cut
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.inspect.summary import byte_size
    from softprint.runtime.scenes.motion_file import load_motion

    def moment(option: str, text: str | None) -> Moment | None:
        try:
            return None if text is None else Moment.parse(text)
        except ValueError:
            raise SoftprintError(
                f"{option} {text}: this is neither a time in seconds, such as 0.5, nor a frame, such as 30f"
            ) from None

    sampling = Sampling(moment("--from", args.begin), moment("--to", args.end), args.every, args.rate)
    try:
        look = FilmLook(args.width, None if args.cut is None else Cut.parse(args.cut))
    except ValueError:
        raise SoftprintError(
            f"--cut {args.cut}: this is no plane; one is an axis and a number of metres, such as y=0.01"
        ) from None
    found = find_format(args.out)  # a wrong ending is known before a large file is read
    with context.stage(f"reading {args.motion.name}"):
        source = load_motion(args.motion)
        plan = plan_conversion(source, args.out, sampling, args.colour, not args.no_colliders, look)
    with context.progress(len(plan.motion), "frames", args.out.name) as bar:
        files = plan.write(bar.update)
    size = sum(path.stat().st_size for path in files)
    named = ", ".join(map(str, files[:2])) + (f" ... {files[-1].name}" if len(files) > 2 else "")
    context.say(
        f"{named}: {found.what}, {len(plan.motion)} frames at {plan.motion.rate:.4g} a second, {byte_size(size)}"
    )
    left_out = [name for name in source.colliders if name not in plan.motion.solids]
    if left_out and not args.no_colliders:
        context.say(f"without {', '.join(left_out)}: a collider without bounds has no surface")
    return 0


VERB = Verb(
    name="convert",
    order=44,
    summary="A motion for Blender, web viewers and other programs: glTF, USD, PC2, OBJ, GIF, MP4.",
    example="softprint convert runs/jelly3d_small/motions/held_out_bare.h5 press.gif",
    run=run,
    needs=("h5py",),
    configure=configure,
    reads_experiment=False,
)
