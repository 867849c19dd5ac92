"""Residual TCN (control.estimation.networks.residual_tcn) as a PyTorch module for training: same parameters, batched."""

import torch
from torch import nn
from torch.nn import functional

from control.estimation.networks.residual_tcn import BlockTaps, TcnShape, block_taps, tap_rows


class CausalBlock(nn.Module):
    """Two dilated causal convolutions with ReLU and dropout, and a skip connection, on the needed lags only."""

    def __init__(self, channels: int, shape: TcnShape, taps: BlockTaps, dropout: float) -> None:
        super().__init__()
        width, kernel = shape.width, shape.kernel
        self.conv1 = nn.Conv1d(channels, width, kernel, dilation=taps.dilation)
        self.conv2 = nn.Conv1d(width, width, kernel, dilation=taps.dilation)
        self.skip = nn.Conv1d(channels, width, 1) if channels != width else None
        self.dropout = nn.Dropout(dropout)
        self._rows1 = torch.as_tensor(tap_rows(taps.inputs, taps.middle, taps.dilation, kernel))
        self._rows2 = torch.as_tensor(tap_rows(taps.middle, taps.outputs, taps.dilation, kernel))
        self._skip_rows = torch.tensor([taps.inputs.index(lag) for lag in taps.outputs])

    def forward(self, steps: torch.Tensor) -> torch.Tensor:
        """(batch, input lags, channels) to (batch, output lags, width)."""
        middle = self.dropout(torch.relu(_convolve(steps, self._rows1, self.conv1)))
        output = self.dropout(torch.relu(_convolve(middle, self._rows2, self.conv2)))
        skipped = steps[:, self._skip_rows]
        if self.skip is not None:
            skipped = functional.linear(skipped, self.skip.weight[:, :, 0], self.skip.bias)
        return torch.relu(output + skipped)


class TcnModule(nn.Module):
    """Residual force network, paper Sec. II.D. Its state_dict is what `residual_tcn.ResidualTcn` takes."""

    def __init__(self, shape: TcnShape, dropout: float = 0.1) -> None:
        super().__init__()
        taps = block_taps(shape)
        channels = [shape.inputs, *[shape.width] * (len(taps) - 1)]
        self.shape = shape
        self.blocks = nn.ModuleList(CausalBlock(c, shape, tap, dropout) for c, tap in zip(channels, taps, strict=True))
        self.head = nn.ModuleList([nn.Linear(shape.width, shape.head), nn.Linear(shape.head, shape.outputs)])
        self.dropout = nn.Dropout(dropout)
        self._input_steps = torch.tensor([shape.history - 1 - lag for lag in taps[0].inputs])

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """(batch, H, inputs), oldest step first, to the newest output (batch, outputs)."""
        steps = windows[:, self._input_steps]
        for block in self.blocks:
            steps = block(steps)
        hidden = self.dropout(torch.relu(self.head[0](steps[:, 0])))
        return self.head[1](hidden)


def _convolve(steps: torch.Tensor, rows: torch.Tensor, convolution: nn.Conv1d) -> torch.Tensor:
    """Convolution at the target lags whose taps `rows` (targets, kernel) names; the row past the end is zero padding."""
    padded = functional.pad(steps, (0, 0, 0, 1))
    stacked = padded[:, rows].flatten(2)
    # The module's last tap meets the newest step, `rows` lists the newest first.
    matrix = convolution.weight.flip(2).transpose(1, 2).flatten(1)
    return functional.linear(stacked, matrix, convolution.bias)
