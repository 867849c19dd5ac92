"""Causal temporal convolutional network of the residual force correction, paper Sec. II.D, at its newest output.

Each of the blocks runs two dilated causal convolutions with ReLU and adds its input; an MLP head maps the newest output to
the force. A causal convolution pads the window with zeros on its old side. Only the newest output is wanted, so only the
taps that reach it are computed: the same function as the full network at about a third of the work.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from control.compiled import kernel


@dataclass(frozen=True, slots=True)
class TcnShape:
    """Sizes of the network; the defaults are the paper's.

    Attributes:
        inputs: features per time step.
        outputs: 3 for a force, 6 for a force and the logarithm of its variance.
        history: H, time steps in the window.
        width: channels of every block.
        kernel: taps of every convolution.
        dilations: one block each, oldest first.
        head: hidden units of the MLP head.
    """

    inputs: int
    outputs: int
    history: int = 20
    width: int = 64
    kernel: int = 3
    dilations: tuple[int, ...] = (1, 2, 4, 8, 16)
    head: int = 128


@dataclass(frozen=True, slots=True)
class BlockTaps:
    """Which time steps of one block matter for the newest output, as lags (0 = newest) in ascending order.

    Attributes:
        dilation: of both convolutions.
        inputs: lags needed of the block's input.
        middle: lags needed after its first convolution.
        outputs: lags needed of its output.
    """

    dilation: int
    inputs: tuple[int, ...]
    middle: tuple[int, ...]
    outputs: tuple[int, ...]


def block_taps(shape: TcnShape) -> tuple[BlockTaps, ...]:
    """Needed lags of every block, first block first; lags beyond the window are zero padding and not listed."""

    def reached(lags: tuple[int, ...], dilation: int) -> tuple[int, ...]:
        every = {lag + tap * dilation for lag in lags for tap in range(shape.kernel)}
        return tuple(sorted(lag for lag in every if lag < shape.history))

    outputs: tuple[int, ...] = (0,)
    taps: list[BlockTaps] = []
    for dilation in reversed(shape.dilations):
        middle = reached(outputs, dilation)
        inputs = reached(middle, dilation)
        taps.append(BlockTaps(dilation, inputs, middle, outputs))
        outputs = inputs
    return tuple(reversed(taps))


def tap_rows(source: tuple[int, ...], target: tuple[int, ...], dilation: int, kernel: int) -> np.ndarray:
    """(len(target), kernel) row of `source` for each tap, newest tap first; len(source) stands for the zero padding."""
    row = {lag: index for index, lag in enumerate(source)}
    return np.array([[row.get(lag + tap * dilation, len(source)) for tap in range(kernel)] for lag in target])


def parameter_shapes(shape: TcnShape) -> dict[str, tuple[int, ...]]:
    """Name and array shape of every parameter, as PyTorch names and lays them out."""
    shapes: dict[str, tuple[int, ...]] = {}
    channels = shape.inputs
    for index in range(len(shape.dilations)):
        prefix = f"blocks.{index}"
        shapes[f"{prefix}.conv1.weight"] = (shape.width, channels, shape.kernel)
        shapes[f"{prefix}.conv1.bias"] = (shape.width,)
        shapes[f"{prefix}.conv2.weight"] = (shape.width, shape.width, shape.kernel)
        shapes[f"{prefix}.conv2.bias"] = (shape.width,)
        if channels != shape.width:
            shapes[f"{prefix}.skip.weight"] = (shape.width, channels, 1)
            shapes[f"{prefix}.skip.bias"] = (shape.width,)
        channels = shape.width
    shapes["head.0.weight"] = (shape.head, shape.width)
    shapes["head.0.bias"] = (shape.head,)
    shapes["head.1.weight"] = (shape.outputs, shape.head)
    shapes["head.1.bias"] = (shape.outputs,)
    return shapes


@kernel("void(f4[:,::1], i8[:,::1], f4[:,::1], f4[::1], f4[:,::1], f4[:,::1])")
def _convolve(
    source: np.ndarray, taps: np.ndarray, weight: np.ndarray, bias: np.ndarray, stacked: np.ndarray, out: np.ndarray
) -> None:
    """y_i = relu(b + sum_t W_t x_(taps[i, t])) for every time step i of `out`.

    Args:
        source: (s + 1, channels) x, the last row zero: what lies before the window.
        taps: (n, kernel) row of `source` under each tap.
        weight: (kernel * channels, outputs) W, one tap after the other.
        bias: (outputs,) b.
        stacked: (n, kernel * channels) room for what lies under the taps.
        out: (n, outputs) y.
    """
    channels = source.shape[1]
    for i in range(taps.shape[0]):
        for tap in range(taps.shape[1]):
            for channel in range(channels):
                stacked[i, tap * channels + channel] = source[taps[i, tap], channel]
    np.dot(stacked, weight, out)
    for i in range(len(out)):
        for o in range(len(bias)):
            out[i, o] = max(out[i, o] + bias[o], np.float32(0.0))


_CONVOLUTION = "i8[:,::1], f4[:,::1], f4[::1], f4[:,::1], f4[:,::1]"


@kernel(f"void(f4[:,::1], {_CONVOLUTION}, f4[:,::1], {_CONVOLUTION}, i8[::1], f4[:,::1], f4[::1])")
def _residual_block(
    source: np.ndarray,
    taps1: np.ndarray,
    weight1: np.ndarray,
    bias1: np.ndarray,
    stacked1: np.ndarray,
    middle: np.ndarray,
    padded_middle: np.ndarray,
    taps2: np.ndarray,
    weight2: np.ndarray,
    bias2: np.ndarray,
    stacked2: np.ndarray,
    out: np.ndarray,
    skip_steps: np.ndarray,
    skip_weight: np.ndarray,
    skip_bias: np.ndarray,
) -> None:
    """One block: y = relu(conv2(conv1(x)) + S x), S the identity where `skip_weight` is empty.

    Args:
        source: (s + 1, channels) x, the last row zero.
        taps1, weight1, bias1, stacked1, taps2, weight2, bias2, stacked2: of the convolutions, see `_convolve`.
        middle: (m, width) what the first one gives; in the memory of
        padded_middle: (m + 1, width), whose last row is zero.
        out: (n, width) y.
        skip_steps: (n,) row of `source` at each step of `out`.
        skip_weight, skip_bias: (channels, width) and (width,) of S.
    """
    _convolve(source, taps1, weight1, bias1, stacked1, middle)
    _convolve(padded_middle, taps2, weight2, bias2, stacked2, out)
    for i in range(len(out)):
        skipped = source[skip_steps[i]]
        if len(skip_weight) == 0:
            for o in range(len(skipped)):
                out[i, o] += skipped[o]
        else:
            for o in range(len(skip_bias)):
                out[i, o] += skip_bias[o]
            for channel in range(len(skipped)):
                for o in range(len(skip_bias)):
                    out[i, o] += skipped[channel] * skip_weight[channel, o]
        for o in range(out.shape[1]):
            out[i, o] = max(out[i, o], np.float32(0.0))


@kernel("f4[::1](f4[::1], f4[:,::1], f4[::1], f4[:,::1], f4[::1])")
def _head(feature: np.ndarray, weight1: np.ndarray, bias1: np.ndarray, weight2: np.ndarray, bias2: np.ndarray) -> np.ndarray:
    """W2 relu(W1 x + b1) + b2 (outputs,) of x (width,); the weights are (inputs, outputs)."""
    hidden, out = bias1.copy(), bias2.copy()
    for i in range(len(feature)):
        for o in range(len(hidden)):
            hidden[o] += feature[i] * weight1[i, o]
    for i in range(len(hidden)):
        if hidden[i] > np.float32(0.0):
            for o in range(len(out)):
                out[o] += hidden[i] * weight2[i, o]
    return out


class ResidualTcn:
    """The network with fixed parameters, in single precision; holds its work arrays, so one instance per thread."""

    def __init__(self, shape: TcnShape, parameters: Mapping[str, np.ndarray]) -> None:
        """`parameters`: see `parameter_shapes`.

        Raises:
            ValueError: a parameter is missing or has another shape (the message names it).
        """
        for name, expected in parameter_shapes(shape).items():
            if name not in parameters:
                raise ValueError(f"network parameter {name!r} is missing")
            if parameters[name].shape != expected:
                raise ValueError(f"network parameter {name!r} has shape {parameters[name].shape}, expected {expected}")
        self.shape = shape
        taps = block_taps(shape)
        self._input_steps = np.array([shape.history - 1 - lag for lag in taps[0].inputs])
        channels = [shape.inputs, *[shape.width] * len(taps)]
        steps = [*(len(tap.inputs) for tap in taps), 1]
        values = [np.zeros((count + 1, width), np.float32) for count, width in zip(steps, channels, strict=True)]
        self._input, self._feature = values[0][:-1], values[-1][0]
        self._blocks = [
            _block_arguments(shape, tap, parameters, f"blocks.{index}", *values[index : index + 2])
            for index, tap in enumerate(taps)
        ]
        self._head = [_single(parameters[f"head.{layer}.{part}"].T) for layer in range(2) for part in ("weight", "bias")]

    def predict(self, window: np.ndarray) -> np.ndarray:
        """Newest output of the network.

        Args:
            window: (H, inputs) normalised features, oldest first.

        Returns:
            (outputs,) float32.
        """
        np.take(window, self._input_steps, axis=0, out=self._input, mode="clip")
        for arguments in self._blocks:
            _residual_block(*arguments)
        return _head(self._feature, *self._head)


def _block_arguments(
    shape: TcnShape,
    taps: BlockTaps,
    parameters: Mapping[str, np.ndarray],
    prefix: str,
    source: np.ndarray,
    target: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """All arguments of `_residual_block`, from `source` to `target`, which both have a row of zeros at their end."""

    def convolution(name: str, lags: tuple[int, ...], targets: tuple[int, ...], out: np.ndarray) -> tuple[np.ndarray, ...]:
        # PyTorch's last tap meets the newest step; here the newest comes first.
        flipped = parameters[f"{prefix}.{name}.weight"][:, :, ::-1].transpose(2, 1, 0)
        weight = _single(flipped.reshape(-1, shape.width))
        rows = tap_rows(lags, targets, taps.dilation, shape.kernel)
        stacked = np.zeros((len(rows), len(weight)), np.float32)
        return rows, weight, _single(parameters[f"{prefix}.{name}.bias"]), stacked, out

    skip_weight, skip_bias = np.zeros((0, 0), np.float32), np.zeros(0, np.float32)
    if f"{prefix}.skip.weight" in parameters:
        skip_weight = _single(parameters[f"{prefix}.skip.weight"][:, :, 0].T)
        skip_bias = _single(parameters[f"{prefix}.skip.bias"])
    middle = np.zeros((len(taps.middle) + 1, shape.width), np.float32)
    return (
        source,
        *convolution("conv1", taps.inputs, taps.middle, middle[:-1]),
        middle,
        *convolution("conv2", taps.middle, taps.outputs, target[:-1]),
        np.array([taps.inputs.index(lag) for lag in taps.outputs]),
        skip_weight,
        skip_bias,
    )


def _single(values: np.ndarray) -> np.ndarray:
    """In single precision and in one piece."""
    return np.ascontiguousarray(values, np.float32)
