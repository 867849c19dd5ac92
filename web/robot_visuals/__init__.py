"""Visual meshes of the robot, one binary glTF per MJCF body, made from a few parametric shapes."""

from web.robot_visuals.robot import BODY_NAMES, VISUAL_FOLDER, MissingVisualError, build, build_parts, load

__all__ = ["BODY_NAMES", "VISUAL_FOLDER", "MissingVisualError", "build", "build_parts", "load"]
