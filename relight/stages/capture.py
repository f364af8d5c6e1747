"""Measures the maps of one capture of a light stage, instead of baking a mesh."""

import sys
from pathlib import Path

from relight.config import Figures
from relight.errors import UserError
from relight.stages.stage import stage


@stage("capture", figure="name of the capture, such as anna.front", out="maps (.exr)")
def main(figures: Figures, size: int, figure: str, out: Path) -> None:
    """Writes the measured maps of a capture, or the record of a left-out figure.

    Args:
        figures: with the folder of the captures.
        size: side of the maps, pixels.
        figure: name of the capture.
        out: the maps.
    """
    from relight.captures.capture import capture_subject, list_captures
    from relight.captures.maps import training_maps
    from relight.maps import write_left_out, write_maps

    if figures.folder is None:
        raise UserError("figures.folder=<the folder of the captures> is missing")
    captures = list_captures(figures.folder)
    if figure not in captures:
        raise UserError(f"io.figure: {figures.folder} has no capture {figure}; it has {', '.join(captures)}")
    try:
        write_maps(out, training_maps(captures[figure], size))
    except UserError as error:
        print(f"{figure} is left out: {error}", file=sys.stderr)
        write_left_out(out, {"name": figure, "subject": capture_subject(figure)}, str(error))


if __name__ == "__main__":
    main.cli()
