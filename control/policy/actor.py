"""Actor network of the policy in numpy."""

import itertools

import numpy as np


class Actor:
    """The actor network in numpy: linear and ELU layers in float32."""

    def __init__(self, layers: tuple[int, ...], arrays: dict[str, np.ndarray]) -> None:
        """`arrays`: "weight_i" (out, in) and "bias_i" (out,) of layer i.

        Raises:
            ValueError: one is missing or has another shape.
        """
        self._layers = []
        for index, (inputs, outputs) in enumerate(itertools.pairwise(layers)):
            weight, bias = arrays.get(f"weight_{index}"), arrays.get(f"bias_{index}")
            if weight is None or bias is None or weight.shape != (outputs, inputs) or bias.shape != (outputs,):
                raise ValueError(f"layer {index} is not of shape ({outputs}, {inputs})")
            self._layers.append((np.ascontiguousarray(weight, np.float32), np.ascontiguousarray(bias, np.float32)))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action of an observation (inputs,)."""
        value = observation
        for weight, bias in self._layers[:-1]:
            value = weight @ value
            value += bias
            # ELU: x above zero, exp(x) - 1 below.
            value = np.maximum(value, np.expm1(np.minimum(value, 0.0)))
        weight, bias = self._layers[-1]
        return weight @ value + bias
