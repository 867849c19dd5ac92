"""Causal temporal convolutional network of the residual force correction, paper Sec. II.D, at its newest output.

Each of the blocks runs two dilated causal convolutions with ReLU and adds its input; an MLP head maps the newest output to
the force. A causal convolution pads the window with zeros on its old side. Only the newest output is wanted, so only the
taps that reach it are computed: the same function as the full network at about a third of the work.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from control.kernels.compiled import kernel


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


@kernel("void(f4[:,::1], i8[::1], f4[::1], f4[::1], f4[:,::1])")
def _convolve(source: np.ndarray, rows: np.ndarray, parameters: np.ndarray, room: np.ndarray, out: np.ndarray) -> None:
    """y_i = relu(b + sum_t W_t x_(rows[i, t])) for every time step i of `out`.

    Args:
        source: (s + 1, channels) x, the last row zero: what lies before the window.
        rows: (n * kernel,) row of `source` under each tap.
        parameters: W (kernel, channels, outputs), then b (outputs,).
        room: for what lies under the taps.
        out: (n, outputs) y.
    """
    count, outputs = out.shape
    channels = source.shape[1]
    size = len(rows) // count * channels
    for i in range(len(rows)):
        for channel in range(channels):
            room[i * channels + channel] = source[rows[i], channel]
    stacked, weight = room[: count * size].reshape((count, size)), parameters[: size * outputs].reshape((size, outputs))
    np.dot(stacked, weight, out)
    for i in range(count):
        for o in range(outputs):
            out[i, o] = max(out[i, o] + parameters[size * outputs + o], np.float32(0.0))


@kernel("void(f4[:,::1], i8[::1], f4[::1], f4[:,::1])")
def _add_skip(source: np.ndarray, steps: np.ndarray, parameters: np.ndarray, out: np.ndarray) -> None:
    """y_i = relu(y_i + S x_(steps[i])) in place.

    Args:
        source: (s + 1, channels) x.
        steps: (n,) row of `source` at each step of `out`.
        parameters: of S, weight (channels, width) and bias (width,); none where S is the identity.
        out: (n, width) y.
    """
    channels, width = source.shape[1], out.shape[1]
    for i in range(len(out)):
        skipped = source[steps[i]]
        for o in range(width):
            out[i, o] += skipped[o] if len(parameters) == 0 else parameters[channels * width + o]
        if len(parameters) > 0:
            for channel in range(channels):
                for o in range(width):
                    out[i, o] += skipped[channel] * parameters[channel * width + o]
        for o in range(width):
            out[i, o] = max(out[i, o], np.float32(0.0))


@kernel("f4[::1](f4[::1], f4[::1], i8, i8)")
def _head(feature: np.ndarray, parameters: np.ndarray, size: int, outputs: int) -> np.ndarray:
    """W2 relu(W1 x + b1) + b2 (outputs,) of x (width,) by `size` hidden units; W1, b1, W2, b2 in turn are the parameters."""
    width = len(feature)
    second = (width + 1) * size
    hidden = parameters[width * size : second].copy()
    for i in range(width):
        for o in range(size):
            hidden[o] += feature[i] * parameters[i * size + o]
    out = parameters[second + size * outputs :].copy()
    for i in range(size):
        if hidden[i] > np.float32(0.0):
            for o in range(outputs):
                out[o] += hidden[i] * parameters[second + i * outputs + o]
    return out


@kernel("f4[::1](i8[::1], i8[:,::1], i8[::1], f4[::1], f4[::1], f4[::1], matrix)")
def _evaluate(
    shape: np.ndarray,
    sizes: np.ndarray,
    rows: np.ndarray,
    parameters: np.ndarray,
    values: np.ndarray,
    room: np.ndarray,
    window: np.ndarray,
) -> np.ndarray:
    """Newest output (outputs,) of the network: blocks y = relu(conv2(conv1(x)) + S x), then the head.

    All that a network holds lies in a few arrays, because every array that a kernel is given costs time.

    Args:
        shape: (4,) of TcnShape: width, kernel, head, outputs.
        sizes: (blocks, 3) time steps of each block's input, middle and output.
        rows: steps of the window that are read; then of each block the rows under the taps of both convolutions and those of
            the skip.
        parameters: of each block those of both convolutions and of the skip; then of the head.
        values: room for the input and the middle of each block, each with a row of zeros at its end, and for the last output.
        room: for `_convolve`.
        window: (H, inputs) normalised features, oldest first.
    """
    width, taps, hidden, outputs = shape
    channels = window.shape[1]
    row, parameter, source_at = sizes[0, 0], 0, 0
    for i in range(row):
        for channel in range(channels):
            values[i * channels + channel] = window[rows[i], channel]
    for block in range(len(sizes)):
        given, between, wanted = sizes[block]
        middle_at = source_at + (given + 1) * channels
        out_at = middle_at + (between + 1) * width
        source = values[source_at:middle_at].reshape((given + 1, channels))
        middle = values[middle_at : out_at - width].reshape((between, width))
        padded_middle = values[middle_at:out_at].reshape((between + 1, width))
        out = values[out_at : out_at + wanted * width].reshape((wanted, width))

        size = (taps * channels + 1) * width
        _convolve(source, rows[row : row + between * taps], parameters[parameter : parameter + size], room, middle)
        row, parameter = row + between * taps, parameter + size
        size = (taps * width + 1) * width
        _convolve(padded_middle, rows[row : row + wanted * taps], parameters[parameter : parameter + size], room, out)
        row, parameter = row + wanted * taps, parameter + size
        size = 0 if channels == width else (channels + 1) * width
        _add_skip(source, rows[row : row + wanted], parameters[parameter : parameter + size], out)
        row, parameter = row + wanted, parameter + size
        source_at, channels = out_at, width
    return _head(values[source_at : source_at + width], parameters[parameter:], hidden, outputs)


class ResidualTcn:
    """The network with fixed parameters, in single precision; holds its work arrays, so one instance per thread."""

    STATE = ()
    SCRATCH = ("_values", "_room")

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
        self._shape = np.array([shape.width, shape.kernel, shape.head, shape.outputs])
        self._sizes = np.array([[len(tap.inputs), len(tap.middle), len(tap.outputs)] for tap in taps])
        rows = [np.array([shape.history - 1 - lag for lag in taps[0].inputs])]
        for tap in taps:
            rows.append(tap_rows(tap.inputs, tap.middle, tap.dilation, shape.kernel))
            rows.append(tap_rows(tap.middle, tap.outputs, tap.dilation, shape.kernel))
            rows.append(np.array([tap.inputs.index(lag) for lag in tap.outputs]))
        self._rows = np.concatenate([part.ravel() for part in rows])
        flat = [_kernel_order(parameters[name]).ravel() for name in parameter_shapes(shape)]
        self._parameters = np.concatenate(flat).astype(np.float32)
        channels = [shape.inputs, *[shape.width] * (len(taps) - 1)]
        size = sum((len(t.inputs) + 1) * c + (len(t.middle) + 1) * shape.width for t, c in zip(taps, channels, strict=True))
        self._values = np.zeros(size + shape.width, np.float32)
        self._room = np.zeros(int(self._sizes.max()) * shape.kernel * max(channels), np.float32)

    def predict(self, window: np.ndarray) -> np.ndarray:
        """Newest output of the network.

        Args:
            window: (H, inputs) normalised features, oldest first.

        Returns:
            (outputs,) float32.
        """
        return _evaluate(self._shape, self._sizes, self._rows, self._parameters, self._values, self._room, window)


def _kernel_order(parameter: np.ndarray) -> np.ndarray:
    """A parameter of PyTorch's layout as the kernels read it: (taps, inputs, outputs), the newest tap first."""
    return parameter[:, :, ::-1].transpose(2, 1, 0) if parameter.ndim == 3 else parameter.T
