"""Colours of the scene and of the charts.

Forces have two colours of the Okabe-Ito palette (Okabe and Ito, "Color universal design", 2008) and white: the triple that
stays farthest apart on a dark ground for every kind of colour blindness. web/static/style.css repeats them.
"""

from typing import TypeAlias

RGB: TypeAlias = tuple[int, int, int]

COMMANDED: RGB = (230, 159, 0)
ESTIMATED: RGB = (0, 158, 115)
TRUE: RGB = (236, 239, 244)
UNCERTAIN: RGB = (110, 225, 185)
HANDLE: RGB = (240, 228, 66)
CONE: RGB = (150, 160, 180)
CONE_EXCEEDED: RGB = (213, 94, 0)

ESTIMATORS: tuple[RGB, ...] = (
    (213, 94, 0),
    (204, 121, 167),
    (86, 180, 233),
    (240, 228, 66),
    (120, 130, 255),
    (150, 220, 110),
    (160, 130, 100),
)
"""One per estimator, in the order of the snapshot."""

OF_CONTROLLER: RGB = (120, 220, 230)
"""Of a force that the controller itself estimates."""

SHOWN_SIGMAS = 2.0
"""Half-width of what shows the uncertainty of an estimate, in standard deviations."""

SMALL_TEXT = "padding:0 0.75em 0.5em;font-size:0.8em;line-height:1.5"
"""CSS of notes and tables between widgets."""

FAINT = "#a7b3c0"
"""CSS colour of secondary text, also in web/static/viser.css."""

ALERT, CAUTION = "#b3261e", "#8a5a00"
"""CSS backgrounds of boxed messages, whose text is white: grave and less grave."""

BRAND: RGB = (58, 122, 190)
FLOOR: RGB = (24, 28, 34)
GRID_CELL: RGB = (48, 54, 64)
GRID_SECTION: RGB = (74, 84, 98)
TARGET: RGB = (205, 214, 226)


def css(color: RGB) -> str:
    """The colour as CSS writes it, `#rrggbb`."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def in_scene(color: RGB) -> RGB:
    """What to give a lit object so that it appears as `color`: Viser's tone mapping lightens saturated colours."""
    red, green, blue = (round(255 * (channel / 255) ** 2.4) for channel in color)
    return red, green, blue
