"""A controller with a defect, as a contributor may write one."""

import numpy as np

from control.whole_body.controller import Controller, ControllerInput


class Misshapen:
    """Delegates to a sound controller, and after `sound_s` adds arrays that do not fit."""

    def __init__(self, sound: Controller, sound_s: float) -> None:
        self._sound = sound
        self._sound_s = sound_s
        self._start_s: float | None = None

    def reset(self) -> None:
        self._sound.reset()

    def step(self, inputs: ControllerInput) -> np.ndarray:
        time_s = inputs.sensor.time_s
        self._start_s = time_s if self._start_s is None else self._start_s
        return self._sound.step(inputs) + np.zeros(22 if time_s - self._start_s < self._sound_s else 21)
