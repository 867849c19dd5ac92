"""Joint furniture shared by legs and arm: end caps, motor cans and bands. Sizes are metres."""

from web.robot_visuals.part import Part
from web.robot_visuals.shapes import Circle, lathe, slab
from web.robot_visuals.surface import Axis, Surface


def joint_cap(radius: float, height: float, axis: Axis = "y") -> list[Part]:
    """Cover of a joint axis, its open foot at the origin: dark seat, metal bezel, accent dot."""
    seat = lathe([(radius, 0.0), (radius, 0.45 * height)], "high")
    bezel = lathe([(0.84 * radius, 0.4 * height), (0.70 * radius, height)], "high")
    dot = lathe([(0.30 * radius, 0.95 * height), (0.26 * radius, 1.2 * height)], "high")
    return [Part("dark", seat.along(axis)), Part("metal", bezel.along(axis)), Part("accent", dot.along(axis))]


def drum(radius: float, half_width: float, axis: Axis = "y") -> Surface:
    """Motor can centred at the origin."""
    return lathe([(radius, -half_width), (radius, half_width)]).along(axis)


def band(radius: float, height: float, low: float, high: float, axis: Axis = "y") -> Surface:
    """Ridge of `height` around a tube of `radius`, between two heights along `axis`."""
    foot = radius - 0.0005
    return lathe([(foot, low), (radius + height, 0.5 * (low + high)), (foot, high)], "none").along(axis)


def bezel(inner: float, outer: float, low: float, high: float, axis: Axis = "y") -> Surface:
    """Flat ring that stands on a surface, its back open."""
    return lathe([(outer, low), (outer, high), (inner, high)], "none").along(axis)


def inlay(start: Circle, end: Circle, low: float, high: float) -> Surface:
    """Thin stadium-shaped strip, its back open, raised along the build axis."""
    return slab([start, end], [(0.0, low), (0.0, high)], "high")
