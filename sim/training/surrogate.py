"""A stand-in for the real force estimators in training, cheap enough for a batch, with their errors.

    f_hat = gain * LP2(f) + bias + mass_bias (s - 1) + M motion + noise

LP2 is a second-order low-pass, s the robot's mass over nominal, motion what the robot does (MOTION_NAMES), noise a
first-order Gauss-Markov process. The numbers are fitted to recordings of the real estimator in the full simulation by
`python -m sim.training.fit_surrogate`, which writes the file that `fitted_surrogate` reads.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.paths import WEIGHTS_DIRECTORY
from control.timing import CONTROL_PERIOD_S

SURROGATE_FILE = WEIGHTS_DIRECTORY / "estimator_surrogate.json"
MOTION_NAMES = ("forward_velocity", "yaw_rate", "forward_acceleration", "yaw_acceleration")
"""Heading-frame motion of the base that correlates with the error: m/s, rad/s and their derivatives."""


@dataclass(frozen=True, slots=True)
class SurrogateParameters:
    """Attributes:
    natural_frequency_rps, damping_ratio: of the low-pass.
    gain_std: of the gain, per robot and axis, about 1.
    bias_std_n: (3,) per robot.
    mass_bias_n: (3,) per unit of mass scale error.
    motion_n: (3, 4) N per unit of MOTION_NAMES.
    noise_std_n: (3,) stationary.
    noise_memory: correlation of the noise from one control period to the next.
    """

    natural_frequency_rps: float
    damping_ratio: float
    gain_std: float
    bias_std_n: tuple[float, ...]
    mass_bias_n: tuple[float, ...]
    motion_n: tuple[tuple[float, ...], ...]
    noise_std_n: tuple[float, ...]
    noise_memory: float


class SurrogateError(ValueError):
    """The fit cannot be read; the message names the file and the cure."""


def fitted_surrogate(path: Path = SURROGATE_FILE) -> SurrogateParameters:
    """The parameters of the last fit.

    Raises:
        SurrogateError: the file is missing or damaged.
    """
    cure = "run `python -m sim.training.fit_surrogate`"
    if not path.is_file():
        raise SurrogateError(f"{path}: the file is missing; {cure}")
    try:
        values = json.loads(path.read_text())["parameters"]
        tuples = {name: tuple(values[name]) for name in ("bias_std_n", "mass_bias_n", "noise_std_n")}
        return SurrogateParameters(**{**values, **tuples, "motion_n": tuple(tuple(row) for row in values["motion_n"])})
    except (KeyError, TypeError, ValueError) as error:
        raise SurrogateError(f"{path}: it cannot be read ({error}); {cure}") from error


class LowPass:
    """Exact discretisation of w^2 / (s^2 + 2 z w s + w^2), z < 1, with the input held over a period."""

    def __init__(
        self, shape: tuple[int, ...], natural_frequency_rps: np.ndarray | float, damping_ratio: float, period_s: float
    ) -> None:
        w, z = np.asarray(natural_frequency_rps, float), damping_ratio
        decay, damped = np.exp(-z * w * period_s), w * np.sqrt(1.0 - z * z)
        cosine, sine = np.cos(damped * period_s), np.sin(damped * period_s)
        self._a = decay * (cosine + z * w / damped * sine), decay * sine / damped
        self._b = -decay * w * w / damped * sine, decay * (cosine - z * w / damped * sine)
        self.value, self.rate = np.zeros(shape, order="F"), np.zeros(shape, order="F")

    def step(self, value: np.ndarray) -> np.ndarray:
        """The filtered value after one period of `value`."""
        offset = self.value - value
        self.value, self.rate = (
            value + self._a[0] * offset + self._a[1] * self.rate,
            self._b[0] * offset + self._b[1] * self.rate,
        )
        return self.value


class EstimatorSurrogate:
    """Estimates (n, 3), N, in heading, of a batch; the spread between robots widens the fit by `spread`."""

    def __init__(
        self, parameters: SurrogateParameters, mass_scale: np.ndarray, random: np.random.Generator, spread: float = 1.4
    ) -> None:
        """`mass_scale`: (n,) total mass over nominal."""
        count = len(mass_scale)
        self._parameters, self._random = parameters, random
        speed = parameters.natural_frequency_rps * np.exp(random.uniform(-1.0, 1.0, (count, 1)) * np.log(spread))
        self._low_pass = LowPass((count, 3), speed, parameters.damping_ratio, CONTROL_PERIOD_S)
        self._gain = 1.0 + parameters.gain_std * random.standard_normal((3, count)).T
        self._mass_error = np.multiply((mass_scale - 1.0)[:, None], parameters.mass_bias_n, order="F")
        # Some robots have less of the motion-dependent error than the fit, some more: nobody may rely on its sign.
        self._motion = np.asfortranarray(np.array(parameters.motion_n) * random.uniform(0.0, 2.0, (count, 1, 1)))
        self._bias, self._noise = np.zeros((count, 3), order="F"), np.zeros((count, 3), order="F")
        self._last_motion = np.zeros((count, 2), order="F")
        self.force = np.zeros((count, 3), order="F")

    def reset(self, ids: np.ndarray) -> None:
        """Start from no force, with a new bias."""
        for array in (self._low_pass.value, self._low_pass.rate, self._noise, self._last_motion, self.force):
            array[ids] = 0.0
        self._bias[ids] = self._random.standard_normal((len(ids), 3)) * self._parameters.bias_std_n

    def step(self, force: np.ndarray, velocity: np.ndarray) -> None:
        """One control period under a true force (n, 3) N; `velocity` (n, 2): forward m/s and yaw rad/s."""
        parameters, memory = self._parameters, self._parameters.noise_memory
        acceleration = (velocity - self._last_motion) / CONTROL_PERIOD_S
        self._last_motion = velocity.copy(order="K")
        motion = np.concatenate([velocity, np.clip(acceleration, -6.0, 6.0)], axis=1)
        fresh = self._random.standard_normal(self._noise.T.shape).T * parameters.noise_std_n
        self._noise = memory * self._noise + np.sqrt(1.0 - memory * memory) * fresh
        known = self._gain * self._low_pass.step(force) + self._bias + self._mass_error
        self.force = known + np.einsum("ndk,nk->nd", self._motion, motion) + self._noise
