"""Arm: pedestal, yoke, two-plate upper arm, forearm on a gooseneck, three wrist links and the ball tool."""

from math import cos, pi, sin

from web.robot_visuals.joint import drum, inlay, joint_cap
from web.robot_visuals.part import Part, both_sides, moved
from web.robot_visuals.shapes import Station, lathe, loft, slab

SHOULDER_Z_M = 0.045
ELBOW_X_M = -0.35
WRIST_X_M, WRIST_Z_M = 0.218, 0.057
WRIST_YAW_X_M = 0.07
BALL_RADIUS_M = 0.02


def arm_base_parts() -> list[Part]:
    """Fixed pedestal with a light ring under the turntable."""
    return [
        Part("trim", lathe([(0.0500, 0.0), (0.0500, 0.0060), (0.0460, 0.0080)], "low")),
        Part("dark", lathe([(0.0460, 0.008), (0.0440, 0.020), (0.0446, 0.0450)], "none")),
        Part("glow", lathe([(0.0446, 0.0450), (0.0446, 0.0490)], "none")),
        Part("dark", lathe([(0.0446, 0.0490), (0.0425, 0.0500), (0.0425, 0.0580)], "high")),
    ]


def arm_link1_parts() -> list[Part]:
    """Turntable and the fork that holds the shoulder drum."""
    cheek = [(0.0, SHOULDER_Z_M, 0.0370), (-0.030, 0.010, 0.012), (0.030, 0.010, 0.012)]
    side = [
        Part("shell", slab(cheek, [(0.001, 0.0365), (0.0, 0.0490), (0.0040, 0.0545), (0.0110, 0.0570)]).along("y")),
        *moved(joint_cap(0.0230, 0.0055), y=0.0560, z=SHOULDER_Z_M),
    ]
    return [Part("dark", lathe([(0.0465, 0.0), (0.0465, 0.0085), (0.0435, 0.0115)])), *both_sides(side, "y")]


def arm_link2_parts() -> list[Part]:
    """Upper arm: light plates left and right of a dark core, open at the elbow."""
    plate = [(0.0, 0.0, 0.0335), (-0.12, 0.0, 0.0275), (-0.28, 0.0, 0.0250), (ELBOW_X_M, 0.0, 0.0300)]
    core = [(-0.02, 0.0, 0.0255), (-0.28, 0.0, 0.0225)]
    side = [
        Part("shell", slab(plate, [(0.0, 0.0180), (0.0, 0.0260), (0.0045, 0.0315), (0.0120, 0.0340)]).along("y")),
        Part("accent", inlay((-0.105, 0.0, 0.0050), (-0.245, 0.0, 0.0035), 0.0320, 0.0346).along("y")),
        *moved(joint_cap(0.0215, 0.0050), x=ELBOW_X_M, y=0.0330),
    ]
    return [
        Part("metal", drum(0.0345, 0.0182)),
        Part("dark", slab(core, [(0.0, -0.0185), (0.0, 0.0185)], "none").along("y")),
        *both_sides(side, "y"),
    ]


def arm_link3_parts() -> list[Part]:
    """Gooseneck at the elbow, light forearm shell, fork at the wrist."""
    neck = [(0.0, 0.0, 0.0290), (0.052, 0.050, 0.0240)]
    shell = loft(
        [
            Station(0.032, 0.0190, 0.0190),
            Station(0.043, 0.0265, 0.0260, power=3.0),
            Station(0.085, 0.0295, 0.0290, power=3.0),
            Station(0.160, 0.0245, 0.0240, power=3.0),
            Station(0.176, 0.0225, 0.0220),
        ],
        sections=20,
    )
    fork = [(0.166, WRIST_Z_M, 0.0165), (WRIST_X_M, WRIST_Z_M, 0.0235)]
    side = [
        Part("trim", slab(fork, [(0.0, 0.0165), (0.0, 0.0250), (0.0025, 0.0275)]).along("y")),
        *moved(joint_cap(0.0165, 0.0045), x=WRIST_X_M, y=0.0267, z=WRIST_Z_M),
        Part("glow", inlay((0.070, WRIST_Z_M, 0.0025), (0.140, WRIST_Z_M, 0.0025), 0.0250, 0.0297).along("y")),
    ]
    hatch = slab([(0.080, 0.0, 0.011), (0.142, 0.0, 0.009)], [(0.0, 0.024), (0.0, 0.0290), (0.001, 0.0300)], "high")
    return [
        Part("dark", slab(neck, [(0.004, -0.0165), (0.0, -0.0125), (0.0, 0.0125), (0.004, 0.0165)]).along("y")),
        Part("metal", drum(0.0225, 0.0178)),
        Part("shell", shell.along("x").moved(z=WRIST_Z_M)),
        Part("trim", hatch.moved(z=WRIST_Z_M)),
        Part("metal", lathe([(0.0245, 0.1740), (0.0245, 0.1800)]).along("x").moved(z=WRIST_Z_M)),
        *both_sides(side, "y"),
    ]


def arm_link4_parts() -> list[Part]:
    """Wrist pitch: drum, short tube and a fork for the yaw axis."""
    fork = [(0.036, 0.0, 0.0190), (WRIST_YAW_X_M, 0.0, 0.0215)]
    side = [
        Part("shell", slab(fork, [(0.0, 0.0165), (0.0, 0.0225), (0.005, 0.0275)])),
        *moved(joint_cap(0.0145, 0.0040, "z"), x=WRIST_YAW_X_M, z=0.0265),
    ]
    return [
        Part("metal", drum(0.0225, 0.0162)),
        Part("dark", slab([(0.012, 0.0, 0.016), (0.040, 0.0, 0.0185)], [(0.0, -0.0168), (0.0, 0.0168)])),
        *both_sides(side, "z"),
    ]


def arm_link5_parts() -> list[Part]:
    """Wrist yaw: drum and the roll motor's seat."""
    return [
        Part("metal", drum(0.0200, 0.0162, axis="z")),
        Part("dark", lathe([(0.0145, 0.010), (0.0240, 0.031), (0.0240, 0.0470)]).along("x")),
    ]


def arm_link6_parts() -> list[Part]:
    """Wrist roll: light cup with a glow ring that narrows to the tool flange."""
    return [
        Part("shell", lathe([(0.0255, 0.0), (0.0275, 0.0025), (0.0275, 0.0235), (0.0262, 0.0255)], "low").along("x")),
        Part("glow", lathe([(0.0262, 0.0255), (0.0262, 0.0290)], "none").along("x")),
        Part("dark", lathe([(0.0262, 0.0290), (0.0266, 0.0340), (0.0205, 0.0450), (0.0190, 0.0520)], "none").along("x")),
        Part("metal", lathe([(0.0200, 0.0520), (0.0200, 0.0590), (0.0185, 0.0605)]).along("x")),
    ]


def end_effector_parts() -> list[Part]:
    """Tool: metal stem, ribbed rubber boot, soft ball centred at the origin."""
    arc = [(BALL_RADIUS_M * cos(a), BALL_RADIUS_M * sin(a)) for a in (pi * (k / 11 - 0.5) for k in range(1, 11))]
    ribs = [(radius, -0.050 + 0.0055 * k) for k, radius in enumerate((0.0100, 0.0138, 0.0104, 0.0134, 0.0104, 0.0130, 0.0100))]
    return [
        Part("dark", lathe([(0.0145, -0.0800), (0.0145, -0.0730), (0.0115, -0.0680), (0.0098, -0.0680)], "low").along("x")),
        Part("metal", lathe([(0.0100, -0.0700), (0.0100, -0.0480)], "none").along("x")),
        Part("rubber", lathe(ribs, "low").along("x")),
        Part("soft", lathe([(0.0, -BALL_RADIUS_M), *arc, (0.0, BALL_RADIUS_M)], sections=24).along("x")),
    ]
