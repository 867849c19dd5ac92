"""`python -m web.robot_visuals`: write assets/robot/visual/*.glb and report what was written."""

import sys

from web.robot_visuals import VISUAL_FOLDER, build, build_parts


def main() -> None:
    """Write one file per body into the assets folder and a summary to stdout."""
    faces = sum(len(part.surface.faces) for parts in build_parts().values() for part in parts)
    visuals = build()
    VISUAL_FOLDER.mkdir(parents=True, exist_ok=True)
    for name, data in visuals.items():
        (VISUAL_FOLDER / f"{name}.glb").write_bytes(data)
    size_kb = sum(map(len, visuals.values())) / 1e3
    sys.stdout.write(f"{len(visuals)} bodies, {faces} faces, {size_kb:.0f} kB in {VISUAL_FOLDER}\n")


if __name__ == "__main__":
    main()
