"""`python -m web.robot_visuals`: write assets/robot/visual/*.glb and report what was written."""

import sys

from control.files import write_whole
from web.robot_visuals import VISUAL_FOLDER, build, build_parts


def main() -> None:
    """Write one file per body into the assets folder and a summary to stdout."""
    faces = sum(len(part.surface.faces) for parts in build_parts().values() for part in parts)
    visuals = build()
    for name, data in visuals.items():
        write_whole(VISUAL_FOLDER / f"{name}.glb", data)
    size_kb = sum(map(len, visuals.values())) / 1e3
    sys.stdout.write(f"{len(visuals)} bodies, {faces} faces, {size_kb:.0f} kB in {VISUAL_FOLDER}\n")


if __name__ == "__main__":
    main()
