"""Every widget reaches the state, and every change of the state reaches the widgets."""

import pytest

from tests.browser.console_page import Api, Client, eventually


@pytest.fixture(autouse=True)
def command_tab(client: Client) -> None:
    client.show_tab("Command")


@pytest.mark.parametrize(("axis", "position", "force"), [("x", 0.55, -7.5), ("y", 0.1, 4.0), ("z", 0.62, 12.0)])
def test_an_axis_takes_a_position_or_a_force(client: Client, api: Api, axis: str, position: float, force: float) -> None:
    index = "xyz".index(axis)
    client.enter(f"{axis} [m]", position)
    api.until(lambda state: state["command"]["position_m"][index] == pytest.approx(position), "the position arrives")
    client.field(f"{axis}: force").click()
    api.until(lambda state: state["command"]["mask"][index] == 1, "the axis turns to force")
    client.enter(f"f{axis} [N]", force)
    api.until(lambda state: state["command"]["force_n"][index] == pytest.approx(force), "the force arrives")
    client.field(f"{axis}: force").click()
    api.until(lambda state: state["command"]["mask"][index] == 0, "the axis turns to position")


def test_the_base_velocity_and_its_stop(client: Client, api: Api) -> None:
    for index, (label, value) in enumerate([("ahead [m/s]", 0.2), ("left [m/s]", 0.05), ("turn [rad/s]", -0.1)]):
        client.enter(label, value)
        api.until(lambda state, i=index, v=value: state["command"]["base_velocity"][i] == pytest.approx(v), label)
    client.viser.get_by_role("button", name="Stop the base").click()
    api.until(lambda state: not any(state["command"]["base_velocity"]), "the base stops")


def test_a_slider_moves_by_its_keys(client: Client, api: Api) -> None:
    slider = client.field("ahead [m/s]").get_by_role("slider")
    eventually(lambda: slider.get_attribute("aria-valuenow") == "0", "the page shows the reset")
    slider.press("ArrowRight")
    api.until(lambda state: state["command"]["base_velocity"][0] == pytest.approx(0.05), "one step ahead")


def test_guidance(client: Client, api: Api) -> None:
    client.field("Guidance").click()
    api.until(lambda state: state["command"]["guidance"], "guidance starts")


def test_the_setup(client: Client, api: Api) -> None:
    client.show_tab("Setup")
    api.until(lambda state: not state["mass_adapting"], "the estimator knows the robot")
    client.enter("Robot mass [x]", 1.2)
    api.until(lambda state: state["mass_scale_true"] == pytest.approx(1.2), "the mass changes")
    eventually(lambda: client.text("estimator").endswith(", adapting"), "the bar says why the force is off")
    client.enter("Speed [x]", 0.5)
    api.until(lambda state: state["loop"]["speed"] == pytest.approx(0.5), "the speed changes")
    api.call("PUT", "mismatch", {"mass_scale": 1.0})
    eventually(lambda: float(client.number("Robot mass [x]").input_value()) == 1.0, "the slider shows a change by REST")


def test_the_estimators_side_by_side(client: Client, api: Api) -> None:
    before = api.state()["estimator"]
    client.show_tab("Estimators")
    table = client.viser.locator('[data-forcelens="estimators"]')
    for each in api.call("GET", "estimator")["available"]:
        eventually(lambda name=each["name"]: name in table.inner_text(), "every estimator is listed")
    client.viser.get_by_role("button", name="gmo_pi").click()
    api.until(lambda state: state["estimator"] == "gmo_pi", "one click changes the estimator")
    eventually(lambda: client.text("estimator") == "gmo_pi", "the bar shows it")
    eventually(lambda: "gmo_pi (feeds the controller)" in table.inner_text(), "the table shows it")
    api.call("PUT", "estimator", {"name": before})
    eventually(lambda: f"{before} (feeds the controller)" in table.inner_text(), "the table shows a change by REST")
    client.show_tab("Force on the hand")
    client.show_tab("View")
    client.field("All estimates").click()
    legend = client.viser.locator('[data-forcelens="legend"]')
    eventually(lambda: "gmo_cqp" in legend.inner_text(), "the legend says whose arrow is which")
    client.field("All estimates").click()
    client.show_tab("Command")


def test_another_scene_resets_the_command_and_the_page_says_so(client: Client, api: Api) -> None:
    api.call("PATCH", "command", {"mask": [0, 0, 1], "force_n": [0.0, 0.0, 15.0]})
    eventually(client.field("z: force").is_checked, "the axis turns to force")
    notice = client.viser.get_by_text("The robot is at its start, and")
    for load in (lambda: client.choose("Scene", "box"), lambda: api.call("PUT", "scene", {"name": "free"})):
        client.show_tab("Setup")
        eventually(lambda: notice.count() == 0, "nothing is said yet")
        load()
        notice.first.wait_for()
        client.show_tab("Command")
        eventually(lambda: not client.field("z: force").is_checked(), "the axis shows its default")
        assert api.state()["command"]["mask"] == [0, 0, 0] and api.state()["command"]["force_n"] == [0.0, 0.0, 0.0]


def test_every_scene_loads(client: Client, api: Api) -> None:
    client.show_tab("Setup")
    names = api.call("GET", "scene")["available"]
    for name in [*names[1:], names[0]]:
        client.choose("Scene", name)
        api.until(lambda state, name=name: state["scene"] == name, f"scene {name} loads")
        eventually(lambda name=name: client.text("backend").endswith(name), "the bar shows it")
