"""Train the whole-body policy, from nothing to weights: `python -m sim.train_policy`.

Fits the estimator surrogate if that has not been done, imitates the model-based controller (DAgger), improves on it (PPO)
and writes the checkpoint that scored best on the full stack. Progress, checkpoint, history and curves
go to the run folder; the same command continues a run that was cut off. Several seeds run on an executor.
"""

import argparse
import logging
import shlex
import shutil
import sys
from dataclasses import replace
from pathlib import Path

from control.files import replacing
from control.paths import WEIGHTS_DIRECTORY
from control.policy.observation import EXTENDED_FORM, MEMORYLESS_FORM, PAPER_FORM, RESIDUAL_FORM
from control.policy.policy_weights import PolicyManifest
from sim.processes.executors import EXECUTOR_NAMES, map_unordered
from sim.training import fit_surrogate
from sim.training.policy_training import PolicyTraining
from sim.training.surrogate import SURROGATE_FILE
from sim.training.training_run import PolicyTrainingConfig

logger = logging.getLogger("train_policy")


def train(job: tuple[Path, Path, PolicyTrainingConfig, str]) -> PolicyManifest:
    """One run: `(run folder, folder for the weights, configuration, command)`; importable by an executor's processes."""
    run, output, config, command = job
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    training = PolicyTraining(run, config)
    training.fit()
    return training.export(output, command)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    defaults = PolicyTrainingConfig()
    forms = (RESIDUAL_FORM, EXTENDED_FORM, MEMORYLESS_FORM, PAPER_FORM)
    parser.add_argument("--form", choices=forms, default=defaults.form, help="of the policy, see control.policy.observation")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="one run each; with several, the median is exported")
    parser.add_argument("--count", type=int, default=defaults.count, help="robots in the batch")
    parser.add_argument("--threads", type=int, default=1, help="CPU threads of each run")
    parser.add_argument("--from-scratch", action="store_true", help="PPO without imitation, for comparison")
    parser.add_argument("--imitation-steps", type=int, default=defaults.imitation_steps)
    parser.add_argument("--ppo-iterations", type=int, default=defaults.ppo_iterations)
    parser.add_argument("--score-every", type=int, default=defaults.score_every, help="PPO iterations")
    flag = argparse.BooleanOptionalAction
    parser.add_argument("--bfloat16", action=flag, default=defaults.bfloat16, help="in hidden layers (default: where faster)")
    parser.add_argument("--run", type=Path, help="folder of the run (default runs/NAME)")
    parser.add_argument("--output", type=Path, default=WEIGHTS_DIRECTORY, help="folder for weights and manifest")
    parser.add_argument("--executor", choices=EXECUTOR_NAMES, default="local")
    parser.add_argument("--workers", type=int, default=1, help="runs at a time")
    parser.add_argument("--address", help="of a running Ray cluster")
    options = parser.parse_args(arguments)
    if options.from_scratch and options.form == RESIDUAL_FORM:
        parser.error("--from-scratch needs --form extended or paper: a residual policy starts from the model-based controller")
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    if not SURROGATE_FILE.is_file():
        fit_surrogate.main([])
    words = sys.argv[1:] if arguments is None else arguments
    command = shlex.join(["python", "-m", "sim.train_policy", *words])
    name = "policy_paper" if options.form in (PAPER_FORM, MEMORYLESS_FORM) else "policy"
    if options.from_scratch:
        name += "_from_scratch"
    config = replace(
        defaults,
        name=name,
        form=options.form,
        count=options.count,
        threads=options.threads,
        imitation_steps=0 if options.from_scratch else options.imitation_steps,
        ppo_iterations=options.ppo_iterations,
        score_every=options.score_every,
        bfloat16=options.bfloat16,
    )
    folder = options.run or Path("runs") / name
    jobs = []
    for seed in options.seeds:
        run = folder / f"seed{seed}"
        # A run from scratch is a comparison, and of several seeds the median is the product: neither goes out by itself.
        output = options.output if len(options.seeds) == 1 and not options.from_scratch else run / "best"
        jobs.append((run, output, replace(config, seed=seed), command))
    manifests = list(map_unordered(options.executor, train, jobs, options.workers, options.address))
    totals = sorted((manifest.metrics["score"]["total"], manifest.training["seed"]) for manifest in manifests)
    for total, seed in totals:
        logger.info("seed %d: score %.3f", seed, total)
    if len(jobs) > 1 and not options.from_scratch:
        best = folder / f"seed{totals[len(totals) // 2][1]}" / "best"
        for file in (f"{name}.npz", f"{name}.json"):
            with replacing(options.output / file) as partial:
                shutil.copy2(best / file, partial)


if __name__ == "__main__":
    main()
