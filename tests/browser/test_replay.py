"""A recording in the page: shown, and estimated again by another estimator."""

from collections.abc import Iterator

import pytest

from tests.browser.console_page import Api, Client, eventually


@pytest.fixture
def recorded(api: Api) -> Iterator[str]:
    """Id of a recording of a second."""
    key = api.call("POST", "recordings", {})["id"]
    api.until(lambda state: state["recording"]["duration_s"] > 1.0, "a second is recorded")
    api.call("DELETE", "recordings/current")
    yield key
    api.call("PUT", "backend", {"name": "simulation"})
    api.call("DELETE", f"recordings/{key}")


def test_another_estimator_is_run_over_the_recording_that_is_shown(client: Client, api: Api, recorded: str) -> None:
    api.call("PUT", "backend", {"name": "replay", "options": {"recording": recorded}})
    client.show_tab("Time")
    client.viser.get_by_role("button", name="Estimate", exact=True).click()
    words = client.viser.locator('[data-forcelens="again"]')
    eventually(lambda: "from the truth" in words.inner_text(), "it is done and says how far it is from the truth")
    client.show_tab("Command")
