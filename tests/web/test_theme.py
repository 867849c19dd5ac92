"""The three force colours stay apart for people with colour-vision deficiencies."""

from itertools import combinations

import numpy as np
import pytest

from web.theme import COMMANDED, ESTIMATED, RGB, TRUE, css, in_scene

# Machado, Oliveira and Fernandes, "A physiologically-based model for simulation of color vision deficiency", IEEE TVCG
# 15(6), 2009, severity 1.0; on linear RGB.
DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
    "deuteranopia": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]),
    "tritanopia": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]]),
}
XYZ_FROM_RGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(color: RGB, deficiency: np.ndarray) -> np.ndarray:
    channel = np.array(color) / 255.0
    linear = np.where(channel <= 0.04045, channel / 12.92, ((channel + 0.055) / 1.055) ** 2.4)
    xyz = XYZ_FROM_RGB @ np.clip(deficiency @ linear, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
@pytest.mark.parametrize("shade", [lambda color: color, in_scene], ids=["page", "scene"])
def test_forces_differ_by_much_more_than_a_just_noticeable_difference(deficiency: str, shade: object) -> None:
    colors = [lab(shade(color), DEFICIENCIES[deficiency]) for color in (COMMANDED, ESTIMATED, TRUE)]  # type: ignore[operator]
    distances = [np.linalg.norm(a - b) for a, b in combinations(colors, 2)]
    assert min(distances) > 20.0


def test_css_notation() -> None:
    assert css((230, 159, 0)) == "#e69f00"
