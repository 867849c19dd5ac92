"""Leg links of the left front leg: hip, thigh and calf. The other legs are mirror images."""

from web.robot_visuals.joint import band, drum, inlay, joint_cap
from web.robot_visuals.part import Part, mirrored, moved
from web.robot_visuals.shapes import Station, lathe, loft, rounded, slab

KNEE_Z_M = -0.213
AXLE_Z_M = -0.2264


def hip_parts() -> list[Part]:
    """Abduction drum about x at the origin and the thigh motor's housing about y, which ends at y = 0.078."""
    neck = [Station(0.020, 0.0240, 0.0370, power=3.2), Station(0.0495, 0.0250, 0.0380, power=3.2)]
    housing = [(0.0400, 0.0485), (0.0462, 0.0520), (0.0462, 0.0690), (0.0438, 0.0720)]
    return [
        Part("dark", drum(0.0400, 0.0245, axis="x")),
        Part("metal", band(0.0400, 0.0014, -0.004, 0.004, "x")),
        Part("trim", loft(neck, sections=16, caps="none").along("y")),
        Part("shell", lathe(housing, "low").along("y")),
        Part("accent", lathe([(0.0440, 0.0715), (0.0440, 0.0740), (0.0418, 0.0740)], "none").along("y")),
        Part("dark", lathe([(0.0425, 0.0735), (0.0425, 0.0785)], "high").along("y")),
    ]


def thigh_parts() -> list[Part]:
    """Structural blade, outer cover, inner rib, hip cap and knee drum."""
    blade = [(0.0, 0.0, 0.045), (-0.012, -0.085, 0.031), (0.0, KNEE_Z_M, 0.024)]
    cover = [(0.0, 0.0, 0.0425), (-0.012, -0.085, 0.0285), (-0.001, -0.180, 0.0205)]
    rib = [(-0.010, -0.075, 0.024), (-0.003, -0.165, 0.016)]
    return [
        Part("dark", slab(blade, [(0.006, -0.0165), (0.0, -0.0105), (0.0, 0.0015)]).along("y")),
        Part("shell", slab(cover, [(0.001, 0.0015), (0.0, 0.0110), (0.0035, 0.0165), (0.0100, 0.0190)], "high").along("y")),
        Part("trim", slab(rib, [(0.003, -0.0190), (0.0, -0.0160)], "low").along("y")),
        *moved(joint_cap(0.0260, 0.0060), y=0.0180),
        Part("accent", inlay((-0.013, -0.075, 0.003), (-0.007, -0.150, 0.003), 0.0165, 0.0197).along("y")),
        Part("metal", lathe([(0.0215, -0.0190), (0.0215, 0.0170), (0.0195, 0.0190)]).along("y").moved(z=KNEE_Z_M)),
        Part("dark", drum(0.0120, 0.0202).moved(z=KNEE_Z_M)),
    ]


def calf_parts() -> list[Part]:
    """Shank between the knee and the wheel motor, with a light shin guard."""
    shank = [(0.0, 0.0, 0.0190), (0.012, -0.060, 0.0150), (0.005, -0.205, 0.0120)]
    guard = [(0.018, -0.052, 0.0105), (0.0130, -0.176, 0.0088)]
    motor_cap = mirrored(joint_cap(0.0200, 0.004), "y")
    return [
        Part("dark", slab(shank, rounded(-0.0105, 0.0105, 0.003)).along("y")),
        Part("shell", slab(guard, rounded(-0.0135, 0.0135, 0.004)).along("y")),
        Part("trim", lathe([(0.0260, -0.0170), (0.0300, -0.0130), (0.0300, 0.0150)]).along("y").moved(z=AXLE_Z_M)),
        Part("metal", band(0.0300, 0.0010, -0.003, 0.001).moved(z=AXLE_Z_M)),
        *moved(motor_cap, y=-0.0165, z=AXLE_Z_M),
    ]
