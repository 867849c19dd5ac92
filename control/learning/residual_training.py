"""Train one force network: `python -m control.learning.residual_training --data data/estimator --target hybrid`.

Progress, checkpoint and curves go to the run folder, the weights with their manifest to assets/weights. The same command
resumes where it was cut off.
"""

import argparse
import logging
import shlex
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from control.estimation.networks.force_features import feature_names
from control.estimation.networks.force_network import NetworkManifest
from control.estimation.networks.network_weights import save_network
from control.estimation.networks.residual_tcn import TcnShape
from control.files import replacing
from control.learning.calibration import calibrate
from control.learning.curves import save_curves
from control.learning.evaluation import Prediction, by_cell, cell_metrics, predict, typical_rmse
from control.learning.losses import beta_likelihood, smooth_l1
from control.learning.rollout_data import SETTLE_STEPS, load_split, read_manifest
from control.learning.shrinkage import choose_output_noise
from control.learning.targets import TARGETS, TrainingTarget
from control.learning.tcn_module import TcnModule
from control.learning.windows import Normalization, WindowSet, wanted_force
from control.paths import WEIGHTS_DIRECTORY
from control.provenance import commit
from control.timing import CONTROL_PERIOD_S

logger = logging.getLogger("residual_training")

VALIDATION_STRIDE = 5
OUTPUT_QUANTILE = 0.9999


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """Attributes:
    epochs, samples_per_epoch, batch: windows are drawn at random; an epoch is a fixed number of them.
    learning_rate: peak of the one-cycle schedule.
    weight_decay: of AdamW.
    dropout: the paper's 0.1.
    gradient_limit: norm at which a step's gradient is clipped.
    seed: of initialisation and windows.
    """

    epochs: int = 40
    samples_per_epoch: int = 51_200
    batch: int = 256
    learning_rate: float = 2e-3
    weight_decay: float = 1e-4
    dropout: float = 0.1
    gradient_limit: float = 1.0
    seed: int = 0


class RunError(RuntimeError):
    """A run folder belongs to another training."""


class ResidualTraining:
    """Data, network and optimiser of one run."""

    def __init__(self, target: TrainingTarget, data: Path, run: Path, config: TrainingConfig) -> None:
        """
        Raises:
            DatasetError: `data` holds no usable rollouts.
            RunError: `run` holds a checkpoint of another target, data set or configuration.
        """
        torch.manual_seed(config.seed)
        self.target, self.data, self.run, self.config = target, data, run, config
        train = load_split(data, "train")
        self.validation = load_split(data, "validation")
        self.normalization = Normalization.of(train, target)
        wanted = np.concatenate([wanted_force(rollout, target)[SETTLE_STEPS:] for rollout in train])
        x, y, z = np.quantile(np.abs(wanted), OUTPUT_QUANTILE, axis=0)
        shape = TcnShape(inputs=len(self.normalization.mean), outputs=6 if target.gaussian else 3)
        self.manifest = NetworkManifest(
            name=target.name,
            nominal=target.nominal,
            feature_groups=target.feature_groups,
            increment_groups=target.increment_groups,
            feature_names=feature_names(target.feature_groups),
            shape=shape,
            period_s=CONTROL_PERIOD_S,
            output_scale_n=float(np.sqrt((wanted**2).mean())),
            output_limit_n=(float(x), float(y), float(z)),
            output_noise_n=0.0,
            sigma_scale=(1.0, 1.0, 1.0) if target.gaussian else None,
        )
        self.train_set = WindowSet(train, target, self.normalization, shape.history)
        self.validation_set = WindowSet(self.validation, target, self.normalization, shape.history)
        self.module = TcnModule(shape, config.dropout)
        self.optimizer = torch.optim.AdamW(self.module.parameters(), config.learning_rate, weight_decay=config.weight_decay)
        self.steps_per_epoch = config.samples_per_epoch // config.batch
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimizer, config.learning_rate, total_steps=config.epochs * self.steps_per_epoch, pct_start=0.1
        )
        self.generator = torch.Generator().manual_seed(config.seed)
        self.losses: list[float] = []
        self.validation_rmse: list[float] = []
        self.best_parameters = self._parameters()
        self._resume()

    def fit(self) -> None:
        """Run the epochs that are left; a checkpoint and the curves are written after each."""
        unit = self.manifest.output_scale_n
        reference = self._nominal_rmse()
        while len(self.losses) < self.config.epochs:
            started = time.perf_counter()
            self.module.train()
            total = 0.0
            for _ in range(self.steps_per_epoch):
                windows, learnable, wanted = self.train_set.draw(self.config.batch, self.generator)
                raw = self.module(windows)
                if self.target.gaussian:
                    loss = beta_likelihood(raw, learnable / unit, wanted / unit)
                else:
                    loss = smooth_l1(raw, wanted / unit)
                self.optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(self.module.parameters(), self.config.gradient_limit)
                self.optimizer.step()
                self.schedule.step()
                total += loss.item()
            self.losses.append(total / self.steps_per_epoch)
            self.module.eval()
            self.validation_rmse.append(self._validation_rmse(VALIDATION_STRIDE))
            if self.validation_rmse[-1] <= min(self.validation_rmse):
                self.best_parameters = self._parameters()
            self._save_checkpoint()
            save_curves(self.run / "curves.png", self.target.name, self.losses, self.validation_rmse, reference)
            logger.info(
                "epoch %d/%d: loss %.4f, validation %.3f N (nominal %s), %.0f s",
                len(self.losses),
                self.config.epochs,
                self.losses[-1],
                self.validation_rmse[-1],
                "none" if reference is None else f"{reference:.3f} N",
                time.perf_counter() - started,
            )

    def export(self, directory: Path, command: str) -> NetworkManifest:
        """Write the best epoch's network, shrunk, calibrated and measured on the validation set."""
        self.module.load_state_dict(self.best_parameters)
        self.module.eval()
        if self.target.shrinks:
            self.manifest = replace(self.manifest, output_noise_n=choose_output_noise(self._cells_with_noise))
        if self.target.gaussian:
            scale, slopes = calibrate(self._predict())
            self.manifest = replace(self.manifest, sigma_scale=scale, sigma_slopes=slopes)
        metrics = {
            "validation_typical_rmse_n": round(self._validation_rmse(), 4),
            "cells": cell_metrics(self.validation, self._predict()),
        }
        dataset = read_manifest(self.data)
        training = {
            "command": command,
            "commit": commit(),
            "config": asdict(self.config),
            "best_epoch": int(np.argmin(self.validation_rmse)) + 1,
            "dataset": {key: dataset.get(key) for key in ("seed", "commit", "command")},
            "train_rollouts": self.train_set.rollout_count,
        }
        manifest = replace(self.manifest, training=training, metrics=metrics)
        arrays = {name: tensor.numpy() for name, tensor in self.best_parameters.items()}
        arrays |= {"feature_mean": self.normalization.mean, "feature_std": self.normalization.std}
        path = save_network(directory, manifest, arrays)
        for name, cell in metrics["cells"].items():
            logger.info("%s: %s", name, cell)
        logger.info("wrote %s", path)
        return manifest

    def _cells_with_noise(self, noise_n: float) -> Iterable[list[Prediction]]:
        manifest = replace(self.manifest, output_noise_n=noise_n)
        predictions = predict(self.module, self.validation_set, self.validation, self.target, manifest)
        return by_cell(self.validation, predictions).values()

    def _predict(self, stride: int = 1) -> list[Prediction]:
        return predict(self.module, self.validation_set, self.validation, self.target, self.manifest, stride)

    def _validation_rmse(self, stride: int = 1) -> float:
        return typical_rmse([prediction.error for prediction in self._predict(stride)])

    def _nominal_rmse(self) -> float | None:
        if self.target.nominal is None:
            return None
        return typical_rmse([wanted_force(rollout, self.target)[SETTLE_STEPS:] for rollout in self.validation])

    def _parameters(self) -> dict[str, torch.Tensor]:
        return {name: tensor.detach().clone() for name, tensor in self.module.state_dict().items()}

    @property
    def _identity(self) -> dict[str, Any]:
        """What must be the same for a checkpoint to be continued."""
        return {
            "target": self.target.name,
            "data": str(self.data),
            "config": asdict(self.config),
            "shape": asdict(self.manifest.shape),
        }

    def _save_checkpoint(self) -> None:
        state = {
            "identity": self._identity,
            "module": self.module.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "schedule": self.schedule.state_dict(),
            "generator": self.generator.get_state(),
            "global_generator": torch.get_rng_state(),
            "losses": self.losses,
            "validation_rmse": self.validation_rmse,
            "best_parameters": self.best_parameters,
        }
        with replacing(self.run / "checkpoint.pt") as partial:
            torch.save(state, partial)

    def _resume(self) -> None:
        path = self.run / "checkpoint.pt"
        if not path.is_file():
            return
        state = torch.load(path, weights_only=True)
        if state["identity"] != self._identity:
            raise RunError(f"{path} belongs to another training ({state['identity']}); choose another --run or delete it")
        self.module.load_state_dict(state["module"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.schedule.load_state_dict(state["schedule"])
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["global_generator"])
        self.losses, self.validation_rmse = state["losses"], state["validation_rmse"]
        self.best_parameters = state["best_parameters"]
        logger.info("resumed after epoch %d of %s", len(self.losses), path)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    defaults = TrainingConfig()
    parser.add_argument("--data", type=Path, required=True, help="folder that sim.collect_dataset wrote")
    parser.add_argument("--target", choices=sorted(TARGETS), required=True, help="network to train")
    parser.add_argument("--run", type=Path, help="checkpoint and curves (default runs/TARGET)")
    parser.add_argument("--output", type=Path, default=WEIGHTS_DIRECTORY, help="folder for weights and manifest")
    parser.add_argument("--epochs", type=int, default=defaults.epochs)
    parser.add_argument("--samples-per-epoch", type=int, default=defaults.samples_per_epoch)
    parser.add_argument("--learning-rate", type=float, default=defaults.learning_rate)
    parser.add_argument("--seed", type=int, default=defaults.seed)
    parser.add_argument("--threads", type=int, default=1, help="CPU threads of PyTorch")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    torch.set_num_threads(options.threads)
    config = TrainingConfig(
        epochs=options.epochs,
        samples_per_epoch=options.samples_per_epoch,
        learning_rate=options.learning_rate,
        seed=options.seed,
    )
    training = ResidualTraining(TARGETS[options.target], options.data, options.run or Path("runs") / options.target, config)
    training.fit()
    words = sys.argv[1:] if arguments is None else arguments
    training.export(options.output, shlex.join(["python", "-m", "control.learning.residual_training", *words]))


if __name__ == "__main__":
    main()
