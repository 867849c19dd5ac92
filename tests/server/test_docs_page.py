"""`/docs`: every call and every signal, readable without the Internet."""

import re

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute

from server.answers.schema import EXAMPLES
from server.docs_fields import fields_of
from server.docs_page import docs_page
from server.responses import ANY_CALL
from server.routes import ROUTERS


@pytest.fixture(scope="module")
def page() -> str:
    return docs_page(_document())


def _document() -> dict:
    app = FastAPI(responses=ANY_CALL, generate_unique_id_function=lambda route: route.name)
    for router in ROUTERS:
        app.include_router(router)
    return app.openapi()


def test_every_call_is_shown_and_nothing_is_fetched(page: str) -> None:
    for router in ROUTERS:
        for route in router.routes:
            assert isinstance(route, APIRoute)
            assert re.search(re.sub(r"{\w+}", r"[^/<]+", route.path) + "<", page), route.path
    assert "-40 to 40 N" in page
    assert not re.search(r"(src|href)=.?https?:", page)


@pytest.mark.parametrize(
    ("signal", "manual"),
    [
        ("end_effector.force_true_n", "N, heading, from the simulator; null on hardware"),
        ("base.angular_velocity_rps", "rad/s, in base"),
        ("contacts[].wheel", "FL | FR | RL | RR"),
        ("applied_command.force_n", "pressing down is +z"),
        ("sequence", "counts the commands asked for"),
        ("[].remaining_s", "s of simulated time"),
        ("link.latency_ms", "ms, from a state"),
    ],
)
def test_every_signal_has_its_unit_and_frame(page: str, signal: str, manual: str) -> None:
    rows = re.findall(r"<code>([^<]*)</code>([^\n]*?)(?=<tr>|</table>)", page)
    assert any(path == signal and manual in row for path, row in rows)


def test_every_way_to_be_refused_is_shown(page: str) -> None:
    refusals = page[page.index("<h2>refusals</h2>") :]
    for status in filter(str.isdigit, EXAMPLES):
        assert f"<code>{status}</code>" in refusals


def test_fields_of_parts_follow_their_part() -> None:
    document = _document()
    paths = [field.path for field in fields_of(document, document["components"]["schemas"]["StateAnswer"])]
    assert paths.index("loop.rate_hz") == paths.index("loop") + 1
    assert len(paths) == len(set(paths))
