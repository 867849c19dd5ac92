"""A push test as the page sees it: what it asks for, how far it is, and the plot of what came of it."""

import html
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from web import theme

SHOWN_DEG = 15.0
"""The rim of the plot; what tilts farther, and what falls, stands on it."""

_RINGS_DEG = (5.0, 10.0, 15.0)
_LEVELS: dict[float, tuple[str, theme.RGB]] = {
    1.0: ("upwards", theme.ESTIMATORS[2]),
    0.0: ("level", theme.TRUE),
    -1.0: ("downwards", theme.COMMANDED),
}


@dataclass(frozen=True, slots=True)
class PullOutcome:
    """What one pull did.

    Attributes:
        direction: (3,) in heading, of -1, 0 and 1.
        fell: the robot lies, or its drives damp.
        tilt_deg: largest angle between the base's z axis and up.
        excursion_m: farthest that the hand came from where it was in the heading frame.
    """

    direction: tuple[float, float, float]
    fell: bool
    tilt_deg: float
    excursion_m: float


@dataclass(frozen=True, slots=True)
class PushTestStatus:
    """Attributes:
    running: pulls are still to come.
    planned: how many pulls there are.
    done: what came of those that are over.
    message: how it ended; empty while it runs and before the first.
    """

    running: bool = False
    planned: int = 0
    done: tuple[PullOutcome, ...] = ()
    message: str = ""


class PushTests(Protocol):
    """Runs one push test at a time on the live simulation. The server provides it; from any thread."""

    def start(self, mode: str, force_n: float, directions: int) -> object:
        """Begin; raises a ValueError or a RuntimeError whose message says what to do when it is refused."""

    def cancel(self) -> None:
        """End it soon."""

    def status(self) -> PushTestStatus:
        """How far it is, or how it ended."""
        ...


def spot(outcome: PullOutcome) -> tuple[float, float]:
    """Where an outcome stands in the plot, of radius 1: ahead is up, to the left is left; x to the right, y down."""
    x, y, _ = outcome.direction
    radius = 1.0 if outcome.fell else min(outcome.tilt_deg / SHOWN_DEG, 1.0)
    azimuth = np.arctan2(y, x)
    return float(-radius * np.sin(azimuth)), float(-radius * np.cos(azimuth))


def plot_svg(outcomes: tuple[PullOutcome, ...]) -> str:
    """Largest tilt by direction of the pull, one line per elevation; a cross on the rim for a fall."""
    parts = [_ring(ring) for ring in _RINGS_DEG]
    for level, (_, color) in _LEVELS.items():
        around = [each for each in outcomes if each.direction[2] == level and any(each.direction[:2])]
        around.sort(key=lambda each: np.arctan2(each.direction[1], each.direction[0]))
        points = [spot(each) for each in around]
        shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
        parts.append(f'<polygon points="{shape}" fill="none" stroke="{theme.css(color)}" stroke-width=".015"/>')
        parts += [f'<circle cx="{x:.3f}" cy="{y:.3f}" r=".03" fill="{theme.css(color)}"/>' for x, y in points]
        parts += [_cross(*spot(each)) for each in around if each.fell]
    return f'<svg viewBox="-1.1 -1.1 2.2 2.2" style="width:100%;display:block">{"".join(parts)}</svg>'


def _ring(tilt_deg: float) -> str:
    radius = tilt_deg / SHOWN_DEG
    return (
        f'<circle r="{radius:.3f}" fill="none" stroke="{theme.FAINT}" stroke-width=".006"/>'
        f'<text y="{0.09 - radius:.3f}" font-size=".09" fill="{theme.FAINT}" text-anchor="middle">{tilt_deg:.0f}&deg;</text>'
    )


def _cross(x: float, y: float) -> str:
    path = f"M{x - 0.07:.3f} {y - 0.07:.3f}l.14 .14m0 -.14l-.14 .14"
    return f'<path d="{path}" stroke="{theme.css(theme.CONE_EXCEEDED)}" stroke-width=".03"/>'


def push_test_html(status: PushTestStatus) -> str:
    """Progress, plot and summary of a push test."""
    done = status.done
    lines = []
    if status.running:
        lines.append(f"Pull {min(len(done) + 1, status.planned)} of {status.planned}")
    elif status.message:
        lines.append(html.escape(status.message))
    if done:
        falls = sum(each.fell for each in done)
        lines.append(
            f"Fell: {falls} of {len(done)}; largest tilt {max(each.tilt_deg for each in done):.1f}&deg;; "
            f"hand moved up to {max(each.excursion_m for each in done):.2f} m"
        )
        lines += [
            f"Straight {'up' if each.direction[2] > 0 else 'down'}: {'fell' if each.fell else f'{each.tilt_deg:.1f}&deg;'}"
            for each in done
            if not any(each.direction[:2])
        ]
        shown = {each.direction[2] for each in done if any(each.direction[:2])}
        legend = ", ".join(
            f'<span style="color:{theme.css(color)}">{name}</span>'
            for level, (name, color) in _LEVELS.items()
            if level in shown
        )
        lines.append(f"Largest tilt by direction of the pull (ahead is up): {legend}; a cross fell")
        lines.append(plot_svg(done))
    body = "".join(f"<div>{line}</div>" for line in lines)
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="push-test">{body}</div>'
