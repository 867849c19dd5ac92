"""Calibrate the sigma of a trained network anew: `python -m control.learning.recalibration --data data/calibration`.

Training calibrates on the validation rollouts that also chose its epoch, few of each kind. More robots, which had no part in
the training, tell better how large the errors are. The network itself stays as it is.
"""

import argparse
import logging
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import torch

from control.estimation.networks.force_network import NetworkManifest
from control.estimation.networks.network_weights import load_network, save_network
from control.learning.calibration import calibrate
from control.learning.evaluation import cell_metrics, predict
from control.learning.rollout_data import load_split, read_manifest
from control.learning.targets import TARGETS
from control.learning.tcn_module import TcnModule
from control.learning.windows import Normalization, WindowSet
from control.paths import WEIGHTS_DIRECTORY
from control.provenance import commit
from control.weights_file import load_arrays

logger = logging.getLogger("recalibration")


def recalibrate(data: Path, name: str, directory: Path, command: str) -> NetworkManifest:
    """Fit sigma of the network `name` of `directory` to the validation rollouts of `data` and write its manifest.

    Raises:
        DatasetError: `data` holds no validation rollouts.
        WeightsError: the network does not fit this code.
        ValueError: it states no sigma.
    """
    target, manifest = TARGETS[name], load_network(name, directory).manifest
    arrays = load_arrays(directory / f"{name}.npz")
    rollouts = load_split(data, "validation")
    windows = WindowSet(rollouts, target, Normalization(arrays["feature_mean"], arrays["feature_std"]), manifest.shape.history)
    module = TcnModule(manifest.shape, dropout=0.0)
    module.load_state_dict({key: torch.from_numpy(arrays[key]) for key in module.state_dict()})
    module.eval()
    plain = replace(manifest, sigma_scale=(1.0, 1.0, 1.0), sigma_slopes=())
    scale, slopes = calibrate(predict(module, windows, rollouts, target, plain))
    manifest = replace(manifest, sigma_scale=scale, sigma_slopes=slopes)
    cells = cell_metrics(rollouts, predict(module, windows, rollouts, target, manifest))
    dataset = {key: read_manifest(data).get(key) for key in ("seed", "commit", "command")}
    calibration = {"command": command, "commit": commit(), "dataset": dataset, "rollouts": len(rollouts), "cells": cells}
    manifest = replace(manifest, training={**manifest.training, "calibration": calibration})
    path = save_network(directory, manifest, arrays)
    for kind, cell in cells.items():
        logger.info("%s: %s", kind, cell)
    logger.info("wrote %s: factor %s, slopes %s", path, scale, slopes)
    return manifest


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = sorted(name for name, target in TARGETS.items() if target.gaussian)
    parser.add_argument("--data", type=Path, required=True, help="folder that sim.collect_dataset wrote, --splits validation")
    parser.add_argument("--target", choices=names, default=names[0], help="network to calibrate")
    parser.add_argument("--output", type=Path, default=WEIGHTS_DIRECTORY, help="folder of weights and manifest")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    words = sys.argv[1:] if arguments is None else arguments
    command = shlex.join(["python", "-m", "control.learning.recalibration", *words])
    recalibrate(options.data, options.target, options.output, command)


if __name__ == "__main__":
    main()
