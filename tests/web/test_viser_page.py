"""The served Viser page is the installed one plus our lines, and the page's colours are the scene's."""

import re

import pytest

from sim.backends.hardware.states import TRIP_TEXT, Trip
from sim.runtime.fault_words import FAULT_WORDS
from web import theme
from web.viser_page import CLIENT, STATIC, viser_page


def test_our_script_runs_before_visers() -> None:
    page = viser_page().decode()
    assert page.index("forcelens-key") < page.index("<script data-p=")
    assert page.count("<head>") == 1


def test_nothing_of_viser_is_lost() -> None:
    head, _, rest = viser_page().decode().partition("<head>")
    original = CLIENT.read_text(encoding="utf-8")
    assert original.startswith(head)
    assert original.endswith(rest[-1000:])
    assert len(rest) > len(original) - len(head) - len("<head>")


@pytest.mark.parametrize("path", sorted(STATIC.glob("*.*")), ids=lambda path: path.name)
def test_the_page_loads_nothing_from_elsewhere(path: object) -> None:
    text = path.read_text(encoding="utf-8")  # type: ignore[attr-defined]
    addresses = set(re.findall(r"https?://[^\"'\s)]+", text)) - {"http://www.w3.org/2000/svg"}
    assert not addresses


@pytest.mark.parametrize(
    ("variable", "color"),
    [
        ("commanded", theme.COMMANDED),
        ("estimated", theme.ESTIMATED),
        ("true", theme.TRUE),
        ("grab", theme.HANDLE),
        ("cone", theme.CONE),
        ("exceeded", theme.CONE_EXCEEDED),
    ],
)
def test_the_legend_has_the_colours_of_the_scene(variable: str, color: theme.RGB) -> None:
    style = (STATIC / "style.css").read_text(encoding="utf-8")
    assert f"--{variable}: {theme.css(color)};" in style


@pytest.mark.parametrize("words", [*FAULT_WORDS.values(), *(TRIP_TEXT[trip] for trip in Trip if trip is not Trip.ESTOP)])
def test_the_page_keeps_no_copy_of_the_words_that_the_server_sends(words: str) -> None:
    assert not [path.name for path in STATIC.glob("*.*") if words in path.read_text(encoding="utf-8")]
