"""Causal temporal convolutional network of the residual force correction, paper Sec. II.D, evaluated with numpy.

Each of the blocks runs two dilated causal convolutions with ReLU and adds its input; an MLP head maps the newest output to
the force. A causal convolution pads the window with zeros on its old side. Only the newest output is wanted, so only the
taps that reach it are computed: the same function as the full network at about a third of the work.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


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


class _Convolution:
    """One convolution on the rows that matter; the last row of its padded input stays zero."""

    def __init__(self, weight: np.ndarray, bias: np.ndarray, rows: np.ndarray, source_rows: int) -> None:
        outputs, channels, kernel = weight.shape
        # PyTorch's last tap meets the newest step; here the newest comes first.
        flipped = weight[:, :, ::-1].transpose(2, 1, 0)
        self._matrix = np.ascontiguousarray(flipped.reshape(kernel * channels, outputs), dtype=np.float32)
        self._bias = bias.astype(np.float32)
        self._rows = rows.reshape(-1)
        self._gathered = np.empty((rows.size, channels), np.float32)
        self._stacked = self._gathered.reshape(len(rows), kernel * channels)
        self.padded_input = np.zeros((source_rows + 1, channels), np.float32)

    def run(self, out: np.ndarray) -> None:
        """ReLU of the convolution of `padded_input` into `out` (target rows, outputs)."""
        np.take(self.padded_input, self._rows, axis=0, out=self._gathered, mode="clip")
        np.dot(self._stacked, self._matrix, out=out)
        out += self._bias
        np.maximum(out, 0.0, out=out)


class _Block:
    """Two convolutions and the skip connection."""

    def __init__(self, taps: BlockTaps, parameters: Mapping[str, np.ndarray], prefix: str, kernel: int) -> None:
        weight1, weight2 = parameters[f"{prefix}.conv1.weight"], parameters[f"{prefix}.conv2.weight"]
        rows1 = tap_rows(taps.inputs, taps.middle, taps.dilation, kernel)
        rows2 = tap_rows(taps.middle, taps.outputs, taps.dilation, kernel)
        self._first = _Convolution(weight1, parameters[f"{prefix}.conv1.bias"], rows1, len(taps.inputs))
        self._second = _Convolution(weight2, parameters[f"{prefix}.conv2.bias"], rows2, len(taps.middle))
        self._skip_rows = np.array([taps.inputs.index(lag) for lag in taps.outputs])
        self._skip: tuple[np.ndarray, np.ndarray] | None = None
        if f"{prefix}.skip.weight" in parameters:
            matrix = parameters[f"{prefix}.skip.weight"][:, :, 0].T
            self._skip = np.ascontiguousarray(matrix, np.float32), parameters[f"{prefix}.skip.bias"].astype(np.float32)
        self.input = self._first.padded_input[:-1]

    def run(self, out: np.ndarray) -> None:
        """Output of the block for `input` into `out` (output lags, width)."""
        self._first.run(self._second.padded_input[:-1])
        self._second.run(out)
        skipped = self.input[self._skip_rows]
        if self._skip is not None:
            matrix, bias = self._skip
            skipped = skipped @ matrix + bias
        out += skipped
        np.maximum(out, 0.0, out=out)


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
        self._input_lags = np.array([shape.history - 1 - lag for lag in taps[0].inputs])
        self._blocks = [_Block(tap, parameters, f"blocks.{i}", shape.kernel) for i, tap in enumerate(taps)]
        self._feature = np.empty((1, shape.width), np.float32)
        self._targets = [*(block.input for block in self._blocks[1:]), self._feature]
        self._head = [_head_layer(parameters, index) for index in range(2)]

    def predict(self, window: np.ndarray) -> np.ndarray:
        """Newest output of the network.

        Args:
            window: (H, inputs) normalised features, oldest first.

        Returns:
            (outputs,) float32.
        """
        np.take(window, self._input_lags, axis=0, out=self._blocks[0].input, mode="clip")
        for block, target in zip(self._blocks, self._targets, strict=True):
            block.run(target)
        (hidden_matrix, hidden_bias), (matrix, bias) = self._head
        hidden = self._feature[0] @ hidden_matrix
        hidden += hidden_bias
        np.maximum(hidden, 0.0, out=hidden)
        return hidden @ matrix + bias


def _head_layer(parameters: Mapping[str, np.ndarray], index: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (inputs, outputs) and bias (outputs,) in single precision."""
    matrix = np.ascontiguousarray(parameters[f"head.{index}.weight"].T, np.float32)
    return matrix, parameters[f"head.{index}.bias"].astype(np.float32)
