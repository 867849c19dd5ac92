"""Base body: hull, hip bulkheads, sensor head, tail, deck with the arm's mount plate."""

from web.robot_visuals.joint import bezel, inlay
from web.robot_visuals.part import Part, both_sides, mirrored, moved
from web.robot_visuals.shapes import Circle, lathe, slab

HIP_Y_M = 0.0465
ARM_X_M = 0.1


def base_parts() -> list[Part]:
    """All parts of the base, symmetric about the x-z plane."""
    return [*_hull(), *_bulkheads(), *_head(), *_tail(), *_deck()]


def _rectangle(low_x: float, high_x: float, half_y: float, radius: float) -> list[Circle]:
    """Circles whose outline is a rectangle with rounded corners, on the plan view."""
    return [(x, y, radius) for x in (low_x + radius, high_x - radius) for y in (radius - half_y, half_y - radius)]


def _hull() -> list[Part]:
    """Dark tub, light upper shell with a shadow gap between them, spine through the hips, side inlays."""
    tub = slab(_rectangle(-0.164, 0.164, 0.073, 0.030), [(0.026, -0.060), (0.010, -0.052), (0.0, -0.034), (0.0, 0.001)])
    shell = slab(
        _rectangle(-0.166, 0.166, 0.079, 0.034),
        [(0.006, 0.0), (0.0, 0.003), (0.0, 0.022), (0.004, 0.038), (0.013, 0.050), (0.026, 0.0565)],
        "high",
    )
    spine = slab([(y, z, 0.014) for y in (-0.024, 0.024) for z in (-0.024, 0.026)], [(0.0, -0.230), (0.0, 0.230)], "none")
    sides = [
        Part("accent", inlay((-0.075, 0.013, 0.0035), (0.105, 0.013, 0.0035), 0.074, 0.0798).along("y")),
        *(
            Part("trim", inlay((x - 0.014, -0.022, 0.0025), (x + 0.014, -0.022, 0.0025), 0.066, 0.0742).along("y"))
            for x in _vents()
        ),
    ]
    return [Part("dark", tub), Part("shell", shell), Part("dark", spine.along("x")), *both_sides(sides, "y")]


def _vents() -> list[float]:
    return [-0.08, -0.04, 0.0, 0.04, 0.08]


def _bulkheads() -> list[Part]:
    """Plates that carry the abduction motors: dark on the hull, light covers front and rear."""
    outline = [(-HIP_Y_M, 0.0, 0.0450), (HIP_Y_M, 0.0, 0.0450)]
    inboard = slab(outline, [(0.0, 0.150), (0.0, 0.1640), (0.003, 0.1670)])
    cover = slab(outline, [(0.001, 0.2225), (0.0, 0.2330), (0.006, 0.2420), (0.016, 0.2465)])
    plates = both_sides([Part("dark", inboard.along("x")), Part("shell", cover.along("x"))], "x")
    motor = [
        Part("dark", lathe([(0.0246, 0.2440), (0.0246, 0.2472)], "high").along("x")),
        Part("metal", bezel(0.0215, 0.0250, 0.2440, 0.2480, "x")),
    ]
    lamp = [
        Part("dark", inlay((0.0690, -0.014, 0.0070), (0.0690, 0.014, 0.0070), 0.238, 0.2473).along("x")),
        Part("glow", inlay((0.0690, -0.013, 0.0026), (0.0690, 0.013, 0.0026), 0.247, 0.2480).along("x")),
    ]
    return [*plates, *both_sides(lamp, "y"), *mirrored(both_sides(moved(motor, y=HIP_Y_M), "y"), "x")]


def _head() -> list[Part]:
    """Sensor head: dark glass visor between a light brow and chin, a light bar, two camera eyes and a lidar."""

    def plan(grow: float) -> list[Circle]:
        return [(0.245, y, 0.020 + grow) for y in (-0.034, 0.034)] + [(0.3060, y, 0.026 + grow) for y in (-0.020, 0.020)]

    brow = slab(plan(0.0), [(0.0020, 0.0280), (0.0, 0.0300), (0.0, 0.0400), (0.006, 0.0490), (0.016, 0.0530)])
    visor = slab(plan(-0.002), [(0.0, -0.0150), (0.0, 0.0285)], "none")
    chin = slab(plan(0.0), [(0.016, -0.0400), (0.007, -0.0360), (0.0, -0.0260), (0.0, -0.0165), (0.002, -0.0145)])
    bar = slab([(0.3065, y, 0.025) for y in (-0.020, 0.020)], [(0.0, 0.0200), (0.0, 0.0240)])
    eye = [
        Part("metal", bezel(0.0068, 0.0088, 0.326, 0.3322, "x")),
        Part("glass", lathe([(0.0086, 0.326), (0.0086, 0.3305), (0.0040, 0.3312)], "high").along("x")),
    ]
    lidar = [
        Part("glass", lathe([(0.0210, 0.050), (0.0210, 0.0640)], "none").moved(x=0.270)),
        Part("trim", lathe([(0.0218, 0.0640), (0.0218, 0.0670), (0.0185, 0.0695)]).moved(x=0.270)),
    ]
    return [
        Part("shell", brow),
        Part("glass", visor),
        Part("dark", chin),
        Part("glow", bar),
        *lidar,
        *both_sides(moved(eye, y=0.0170, z=0.0030), "y"),
    ]


def _tail() -> list[Part]:
    plate = slab(
        [(y, z, 0.010) for y in (-0.020, 0.020) for z in (-0.016, 0.018)],
        [(0.004, -0.254), (0.0, -0.250), (0.0, -0.240)],
        "low",
    )
    light = slab([(-0.016, 0.014, 0.0022), (0.016, 0.014, 0.0022)], [(0.0, -0.2555), (0.0, -0.250)], "low")
    return [Part("dark", plate.along("x")), Part("accent", light.along("x"))]


def _deck() -> list[Part]:
    """Rails, the arm's mount plate with four bolts, and the computer with cooling fins and a status lamp."""
    rail = inlay((-0.110, 0.058, 0.0050), (0.118, 0.058, 0.0050), 0.048, 0.0590)
    mount = slab(_rectangle(ARM_X_M - 0.058, ARM_X_M + 0.052, 0.052, 0.012), [(0.0, 0.0540), (0.0, 0.0590), (0.0015, 0.0605)])
    bolts = [lathe([(0.0045, 0.060), (0.0045, 0.0628)], "high").moved(x=ARM_X_M + x, y=0.0425) for x in (-0.0465, 0.0405)]
    computer = slab(
        _rectangle(-0.135, 0.020, 0.042, 0.014), [(0.0, 0.054), (0.0, 0.0720), (0.004, 0.0785), (0.012, 0.0810)], "high"
    )
    fins = [inlay((x, -0.024, 0.002), (x, 0.024, 0.002), 0.080, 0.0845) for x in (-0.104, -0.094, -0.084, -0.074)]
    lamp = inlay((-0.050, 0.0, 0.0030), (-0.010, 0.0, 0.0030), 0.080, 0.0820)
    return [
        *both_sides([Part("trim", rail), *(Part("dark", bolt) for bolt in bolts)], "y"),
        Part("metal", mount),
        Part("dark", computer),
        *(Part("trim", fin) for fin in fins),
        Part("glow", lamp),
    ]
