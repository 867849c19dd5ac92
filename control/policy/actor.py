"""Actor network of the policy: linear layers, ELU between them, float32."""

import itertools
import math

import numpy as np

from control.kernels.compiled import kernel


@kernel("void(f4[:,::1], f4[::1], f4[::1], b1, f4[::1])")
def _layer(weight: np.ndarray, bias: np.ndarray, inputs: np.ndarray, elu: bool, out: np.ndarray) -> None:
    """y = f(W x + b); f is ELU, x above zero and exp(x) - 1 below, or the identity.

    Args:
        weight: (inputs, outputs) W^T, so that the inner loop runs over outputs and sums nothing.
        bias: (outputs,) b.
        inputs: (inputs,) x.
        elu: f is ELU.
        out: (outputs,) y.
    """
    out[:] = bias
    for i in range(len(inputs)):
        value = inputs[i]
        for o in range(len(out)):
            out[o] += value * weight[i, o]
    if elu:
        for o in range(len(out)):
            if out[o] < 0.0:
                out[o] = math.expm1(out[o])


class Actor:
    """The actor network of one robot."""

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
            self._layers.append((np.array(weight.T, np.float32, order="C"), np.array(bias, np.float32)))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action, float32, of an observation (inputs,), float32."""
        value = observation
        for index, (weight, bias) in enumerate(self._layers, start=1):
            out = np.empty(len(bias), np.float32)
            _layer(weight, bias, value, index < len(self._layers), out)
            value = out
        return value
