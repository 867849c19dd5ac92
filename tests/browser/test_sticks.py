"""A virtual gamepad, and the sticks on a touch screen: who holds them drives, who lets go stops."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.console_page import Api, Client, eventually
from tests.browser.page_geometry import box, is_on_top

LOOKS = 4
"""A dead-man that is let go stops the base before the page has looked so often at the gamepad: every 25 ms, or it shakes it."""

VIRTUAL_PAD = """() => {
    const button = () => ({ pressed: false, value: 0 });
    const pad = {
        connected: true, mapping: "standard", index: 0, id: "virtual", axes: [0, 0, 0, 0],
        buttons: Array.from({ length: 17 }, button),
        vibrationActuator: { playEffect: async (kind, effect) => { window.shaken.push(effect.strongMagnitude); } },
    };
    window.shaken = [];
    window.sent = [];
    window.pad = pad;
    window.press = (index, pressed) => Object.assign(pad.buttons[index], { pressed, value: Number(pressed) });
    window.looks = 0;
    navigator.getGamepads = () => { window.looks += 1; return pad.connected ? [pad] : [null]; };
    const fetched = window.fetch;
    window.fetch = (url, options) => {
        if (options?.method === "PATCH") window.sent.push([window.looks, JSON.parse(options.body)]);
        return fetched(url, options);
    };
    window.restore = () => { window.fetch = fetched; delete navigator.getGamepads; };
}"""
"""Puts a gamepad into the browser, counts how often the page looks at it, and keeps what the page asks for, with that count."""

LB, B, RIGHT_TRIGGER = 4, 1, 7


def on_page(client: Client, script: str) -> Any:
    return client.page.evaluate(f"() => {{ {script} }}")


@pytest.fixture
def pad(client: Client, api: Api) -> Iterator[Client]:
    client.page.evaluate(VIRTUAL_PAD)
    yield client
    on_page(client, "pad.connected = false")
    eventually(lambda: api.state()["command"]["base_velocity"] == [0, 0, 0], "the base stands")
    on_page(client, "restore()")
    if client.text("driver") == "you":
        client.page.get_by_test_id("drive").click()
    eventually(lambda: client.text("driver") == "anyone", "nobody drives any more")


def test_the_dead_man_drives_and_letting_go_stops(pad: Client, api: Api) -> None:
    on_page(pad, "pad.axes = [0, -1, 0, 0]")
    on_page(pad, "return new Promise((resume) => setTimeout(resume, 200))")
    assert on_page(pad, "return sent.length") == 0, "without the dead-man, sticks do nothing"
    on_page(pad, f"press({LB}, true)")
    api.until(lambda state: state["command"]["base_velocity"] == [0.4, 0, 0], "full stick ahead drives ahead")
    assert pad.text("driver") == "you", "who drives holds the lease, so that others see who"
    on_page(pad, "pad.axes = [1, 0, 0, 0]")
    api.until(lambda state: state["command"]["base_velocity"] == [0, 0, -0.4], "the stick to the right turns right")
    let_go = on_page(pad, f"press({LB}, false); return looks")
    api.until(lambda state: state["command"]["base_velocity"] == [0, 0, 0], "letting go stops")
    stops = [look for look, command in on_page(pad, "return sent") if look > let_go and command["base_velocity"] == [0, 0, 0]]
    assert stops[0] <= let_go + LOOKS, "without waiting for anything"


def test_stick_and_triggers_move_the_hand(pad: Client, api: Api) -> None:
    start = api.state()["command"]["position_m"]
    on_page(pad, f"pad.axes = [0.05, -0.05, 0, 0.5]; pad.buttons[{RIGHT_TRIGGER}].value = 1; press({LB}, true)")
    state = api.until(lambda state: state["command"]["position_m"][2] > start[2] + 0.03, "the trigger lifts the hand")
    assert state["command"]["position_m"][0] < start[0], "the stick pulls it back"
    assert state["command"]["base_velocity"] == [0, 0, 0], "a stick that is hardly moved does nothing"


def test_a_lost_gamepad_and_a_hidden_page_let_go(pad: Client, api: Api) -> None:
    for lose in ("pad.connected = false", "Object.defineProperty(document, 'hidden', { value: true, configurable: true })"):
        on_page(pad, f"pad.connected = true; pad.axes = [0, -1, 0, 0]; press({LB}, true)")
        api.until(lambda state: state["command"]["base_velocity"][0] > 0, "it drives")
        on_page(pad, lose)
        api.until(lambda state: state["command"]["base_velocity"] == [0, 0, 0], lose)
    on_page(pad, "delete document.hidden")


def test_its_button_stops_without_the_dead_man_and_it_shakes_with_the_force(pad: Client, api: Api) -> None:
    api.call("POST", "wrenches", {"force_n": [0, 0, 16], "frame": "heading", "duration_s": 60})
    on_page(pad, f"press({LB}, true)")
    shaken = eventually(lambda: [felt for felt in on_page(pad, "return shaken") if felt > 0.2], "it shakes")
    assert all(0.0 <= felt <= 1.0 for felt in shaken)
    on_page(pad, f"press({LB}, false); press({B}, true)")
    api.until(lambda state: state["mode"] == "estop", "its button stops")
    on_page(pad, f"press({B}, false)")


def test_sticks_on_the_screen_drive_while_they_are_touched(pad: Client, api: Api) -> None:
    pad.page.add_style_tag(content=".sticks-toggle { display: block !important; }")
    pad.page.get_by_test_id("sticks").click()
    for name in ("stick-base", "stick-hand", "estop"):
        assert is_on_top(pad, name), name
    start = api.state()["command"]["position_m"]
    for name, moved in (
        ("stick-base", lambda state: state["command"]["base_velocity"][0] > 0.3),
        ("stick-hand", lambda state: state["command"]["position_m"][2] > start[2] + 0.02),
    ):
        stick = box(pad.page.get_by_test_id(name))
        pad.page.mouse.move(stick["x"] + stick["width"] / 2, stick["y"] + 4)
        pad.page.mouse.down()
        api.until(moved, f"{name} moves")
        pad.page.mouse.up()
        api.until(lambda state: state["command"]["base_velocity"] == [0, 0, 0], "letting go stops")
    pad.page.get_by_test_id("sticks").click()
