"""Train the methods that the paper compares with, on this robot: `python -m sim.train_baselines`.

One run for each method and seed: imitation of the model-based controller, then PPO under the published reward, and from the
same imitation PPO under the retuned one. Environment steps, randomisation, imitation and PPO are those of `sim.train_policy`.
The same command continues runs that were cut off; `--names policy policy_paper` trains ours on the same budget, into the run
folders alone.
"""

import argparse
import json
import logging
import shlex
import shutil
import sys
from dataclasses import replace
from pathlib import Path

from control.baselines.baseline_weights import BASELINE_NAMES, METHODS, RETUNED
from control.files import replacing, write_whole
from control.paths import WEIGHTS_DIRECTORY
from control.policy.observation import PAPER_FORM, RESIDUAL_FORM
from control.policy.policy_weights import POLICY_NAMES
from sim.processes.executors import EXECUTOR_NAMES, map_unordered
from sim.training import fit_surrogate
from sim.training.baselines.training import BaselineTraining
from sim.training.policy_training import PolicyTraining
from sim.training.surrogate import SURROGATE_FILE
from sim.training.training_run import PolicyTrainingConfig

logger = logging.getLogger("train_baselines")

_FORMS = {"policy": RESIDUAL_FORM, "policy_paper": PAPER_FORM}

Job = tuple[Path, list[str], PolicyTrainingConfig, str]
"""Folder of all runs, names that share an imitation, what they have in common, command."""

Result = tuple[str, int, float]
"""Name, seed and score."""


def train(job: Job) -> list[Result]:
    """The runs of one method and seed, one after the other; importable by an executor's processes."""
    folder, names, config, command = job
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(process)d %(message)s", datefmt="%H:%M:%S")
    results, warm_start = [], None
    for name in names:
        run, mine = folder / name / f"seed{config.seed}", replace(config, name=name)
        if name in _FORMS:
            training = PolicyTraining(run, replace(mine, form=_FORMS[name]))
        else:
            method = name.removesuffix(RETUNED)
            training = BaselineTraining(run, replace(mine, form=method), warm_start)
            if training.config.imitation_steps and warm_start is None:
                training.imitate()
                warm_start = training.imitation
        training.fit()
        manifest = training.export(run / "best", command)
        results.append((name, config.seed, manifest.metrics["score"]["total"]))
    return results


def export_medians(folder: Path, output: Path, results: list[Result]) -> None:
    """Copy each baseline's median of its seeds to `output`, and write all scores to scores.json."""
    scores: dict[str, dict[int, float]] = {}
    for name, seed, total in results:
        scores.setdefault(name, {})[seed] = total
    for name, totals in scores.items():
        ranked = sorted(totals, key=lambda seed: totals[seed])
        chosen = ranked[len(ranked) // 2]
        spread = f"{totals[ranked[0]]:.3f} to {totals[ranked[-1]]:.3f}"
        logger.info("%s: median %.3f (seed %d), %d seeds, %s", name, totals[chosen], chosen, len(ranked), spread)
        if name in BASELINE_NAMES:
            for file in (f"{name}.npz", f"{name}.json"):
                with replacing(output / file) as partial:
                    shutil.copy2(folder / name / f"seed{chosen}" / "best" / file, partial)
    write_whole(folder / "scores.json", json.dumps(scores, indent=1) + "\n")


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    defaults = PolicyTrainingConfig()
    known = (*BASELINE_NAMES, *POLICY_NAMES)
    parser.add_argument("--names", nargs="+", choices=known, default=BASELINE_NAMES, help="default: all baselines")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="one run each; the median is exported")
    parser.add_argument("--count", type=int, default=defaults.count, help="robots in the batch")
    parser.add_argument("--threads", type=int, default=1, help="CPU threads of each run")
    parser.add_argument("--from-scratch", action="store_true", help="PPO without imitation, for comparison; not exported")
    parser.add_argument("--imitation-steps", type=int, default=defaults.imitation_steps)
    parser.add_argument("--ppo-iterations", type=int, default=defaults.ppo_iterations)
    parser.add_argument("--score-every", type=int, default=defaults.score_every, help="PPO iterations")
    parser.add_argument("--score-minutes", type=float, default=defaults.score_minutes, help="of random commands in a score")
    flag = argparse.BooleanOptionalAction
    parser.add_argument("--bfloat16", action=flag, default=defaults.bfloat16, help="in hidden layers (default: where faster)")
    parser.add_argument("--run", type=Path, help="folder of the runs (default runs/baselines)")
    parser.add_argument("--output", type=Path, default=WEIGHTS_DIRECTORY, help="folder for weights and manifests")
    parser.add_argument("--executor", choices=EXECUTOR_NAMES, default="local")
    parser.add_argument("--workers", type=int, default=1, help="runs at a time")
    parser.add_argument("--address", help="of a running Ray cluster")
    options = parser.parse_args(arguments)
    if options.from_scratch and "policy" in options.names:
        parser.error("--from-scratch needs other --names: the policy starts from the model-based controller")
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(process)d %(message)s", datefmt="%H:%M:%S")
    if not SURROGATE_FILE.is_file():
        fit_surrogate.main([])
    words = sys.argv[1:] if arguments is None else arguments
    command = shlex.join(["python", "-m", "sim.train_baselines", *words])
    folder = options.run or Path("runs") / ("baselines_from_scratch" if options.from_scratch else "baselines")
    config = replace(
        defaults,
        count=options.count,
        threads=options.threads,
        imitation_steps=0 if options.from_scratch else options.imitation_steps,
        ppo_iterations=options.ppo_iterations,
        score_every=options.score_every,
        score_minutes=options.score_minutes,
        bfloat16=options.bfloat16,
    )
    methods = [[name for name in options.names if name in (method, method + RETUNED)] for method in METHODS]
    groups = [group for group in methods if group] + [[name] for name in options.names if name in _FORMS]
    jobs = [(folder, group, replace(config, seed=seed), command) for seed in options.seeds for group in groups]
    done = map_unordered(options.executor, train, jobs, options.workers, options.address)
    export_medians(
        folder, folder if options.from_scratch else options.output, [result for results in done for result in results]
    )


if __name__ == "__main__":
    main()
