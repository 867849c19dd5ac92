"""What is shown: camera presets, following, and which arrows. Camera and following are each client's own."""

from collections.abc import Sequence
from typing import Literal

import viser

from web.camera import PRESETS, Camera
from web.estimators_panel import legend_html
from web.force_arrows import ForceArrows
from web.sink import ConsoleSink
from web.wheel_contacts import WheelContacts

_HOTKEYS: tuple[Literal["1", "2", "3", "4", "5"], ...] = ("1", "2", "3", "4", "5")


class ViewPanel:
    """Widgets of the view; build it inside the container that shall hold them."""

    def __init__(
        self,
        server: viser.ViserServer,
        sink: ConsoleSink,
        container: viser.GuiTabHandle,
        camera: Camera,
        forces: ForceArrows,
        contacts: WheelContacts,
    ) -> None:
        self._camera = camera
        with container:
            self._add_presets(server)
            self._add_visibility(server, forces, contacts)
            self._add_estimates(server, forces, sink.available()["estimators"])

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            with container:
                follow = client.gui.add_checkbox(
                    "Follow", False, order=-1.0, hint="The camera travels with the robot. Only in this browser."
                )

            @follow.on_update
            async def _(_: viser.GuiEvent) -> None:
                camera.follow(client, follow.value)

    def _add_presets(self, server: viser.ViserServer) -> None:
        presets = server.gui.add_button_group("Camera", tuple(PRESETS))

        @presets.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._camera.place(event.client, presets.value)

        for name, key in zip(PRESETS, _HOTKEYS, strict=True):
            self._add_preset_command(server, name, key)

    def _add_preset_command(self, server: viser.ViserServer, name: str, key: Literal["1", "2", "3", "4", "5"]) -> None:
        command = server.gui.add_command(f"Camera: {name.lower()}", hotkey=key)

        @command.on_trigger
        async def _(event: viser.CommandEvent) -> None:
            if event.client is not None:
                self._camera.place(event.client, name)

    def _add_visibility(self, server: viser.ViserServer, forces: ForceArrows, contacts: WheelContacts) -> None:
        hand = server.gui.add_checkbox("Hand forces", True)
        wheels = server.gui.add_checkbox("Wheel forces", True)
        cones = server.gui.add_checkbox("Friction cones", True)

        @hand.on_update
        async def _(_: viser.GuiEvent) -> None:
            for arrows in forces.arrows.values():
                arrows.enabled = hand.value

        @wheels.on_update
        async def _(_: viser.GuiEvent) -> None:
            contacts.estimated.enabled = contacts.true.enabled = wheels.value

        @cones.on_update
        async def _(_: viser.GuiEvent) -> None:
            contacts.cones_enabled = cones.value

    def _add_estimates(self, server: viser.ViserServer, forces: ForceArrows, names: Sequence[str]) -> None:
        every = server.gui.add_checkbox(
            "All estimates", False, hint="Thin arrows at the hand for the estimators that do not feed the controller."
        )
        legend = server.gui.add_html(legend_html(names), visible=False)

        @every.on_update
        async def _(_: viser.GuiEvent) -> None:
            forces.others.enabled = legend.visible = every.value
