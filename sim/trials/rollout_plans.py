"""Which rollouts a data set holds: split, mismatch and sensor errors are drawn here, from one seed, before anything runs."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from control.learning.rollout_data import SPLITS
from sim.backends.simulation.mismatch import Mismatch
from sim.backends.simulation.sensors import SensorConfig

HELD_OUT_SHARES = {"validation": 0.3, "test": 0.04}
"""Of all rollouts; the others train. Validation chooses epochs, shrinkage and sigma, so it needs several of every kind."""

HELD_OUT_LENGTH = 2.0
"""Over that of a training rollout. A robot's own error shows over as long a time as it is judged; training gains more from
more robots."""

TRAINING_PROFILES = ("hold", "sine", "slow", "spring")
TRAINING_PROFILE_SHARES = (0.3, 0.3, 0.2, 0.2)
EVALUATION_PROFILES = ("hold", "sine", "slow")
HELD_OUT_PROFILES = (*EVALUATION_PROFILES, "spring")
EVALUATION_FORCE_SCALES = {"hold": 0.7, "sine": 1.0, "slow": 1.0, "spring": 1.0}
"""Of each profile's own force; 0.7 brings the rms slope of hold near 15 N/s."""

TRAINING_FORCE_SCALE_RANGE = (0.5, 1.0)
STILL_SHARE = 0.15
OFF_SITE_SHARE = 0.5
OFF_SITE_STD_M = 0.01
"""What touches the hand rarely does so at the one point that the estimators assume."""

MASS_SCALES = (0.8, 1.0, 1.2)
PER_LINK_RANGE = (0.8, 1.2)


@dataclass(frozen=True, slots=True)
class RolloutPlan:
    """One rollout, reproducible from this alone.

    Attributes:
        index: number within the data set.
        split: of rollout_data.SPLITS.
        seed: of force, motion and sensor errors.
        profile: of sim.trials.rollout_profiles.
        force_scale: of the profile's own force; a spring takes no notice.
        contact_offset_m: (3,) from the modelled point, in end-effector axes, to where the force acts.
        still: no commands; the robot stands where the force leaves it.
        mass_scale, per_link, joint_friction_scale, ground_friction_scale: see sim.backends.simulation.mismatch.
        torque_scale_std: error of the torque constants, 1.
        delay_ticks, torque_delay_ticks: age of the sensor frames, and what the joint torques have besides.
        duration_s: of the recording.
    """

    index: int
    split: str
    seed: int
    profile: str
    mass_scale: float
    per_link: Mapping[str, float] = field(default_factory=dict)
    joint_friction_scale: float = 1.0
    ground_friction_scale: float = 1.0
    torque_scale_std: float = SensorConfig.joint_torque_scale_std
    delay_ticks: int = SensorConfig.delay_ticks
    torque_delay_ticks: int = SensorConfig.torque_delay_ticks
    force_scale: float = 1.0
    contact_offset_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    still: bool = False
    duration_s: float = 20.0

    @property
    def mismatch(self) -> Mismatch:
        """How the simulated robot differs from nominal."""
        return Mismatch(self.mass_scale, self.per_link, self.joint_friction_scale, self.ground_friction_scale)

    @property
    def sensors(self) -> SensorConfig:
        """The default noisy sensors with this plan's torque error and delays."""
        return SensorConfig(
            joint_torque_scale_std=self.torque_scale_std,
            delay_ticks=self.delay_ticks,
            torque_delay_ticks=self.torque_delay_ticks,
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as in the manifest."""
        return {**asdict(self), "contact_offset_m": list(self.contact_offset_m)}


def plan_rollouts(seed: int, count: int, links: tuple[str, ...], duration_s: float) -> list[RolloutPlan]:
    """Plans of a data set.

    Training draws everything; validation and test cover every profile at every mass scale and with random link masses, under
    the default sensors, with random friction.

    Args:
        seed: of the data set.
        count: rollouts in all, at least one per split.
        links: bodies of the robot, for link masses.
        duration_s: of a training rollout; the others last HELD_OUT_LENGTH as long.

    Raises:
        ValueError: `count` is below the number of splits.
    """
    if count < len(SPLITS):
        raise ValueError(f"--rollouts is {count}; at least {len(SPLITS)} are needed, one per split")
    random = np.random.default_rng(seed)
    counts = {split: max(1, round(share * count)) for split, share in HELD_OUT_SHARES.items()}
    counts["train"] = count - sum(counts.values())
    plans: list[RolloutPlan] = []
    for split, size in counts.items():
        for number in range(size):
            index = len(plans)
            own_seed = seed * 1_000_000 + index * 10
            trains = split == "train"
            draw = _training_plan if trains else _evaluation_plan
            length = duration_s if trains else HELD_OUT_LENGTH * duration_s
            plans.append(draw(index, split, own_seed, number, links, length, random))
    return plans


def _training_plan(
    index: int, split: str, seed: int, number: int, links: tuple[str, ...], duration_s: float, random: np.random.Generator
) -> RolloutPlan:
    per_link = _link_scales(links, random)
    uniform = number % 2 == 0
    off_site = random.random() < OFF_SITE_SHARE
    return RolloutPlan(
        index=index,
        split=split,
        seed=seed,
        profile=str(random.choice(TRAINING_PROFILES, p=TRAINING_PROFILE_SHARES)),
        mass_scale=float(random.choice(MASS_SCALES)) if uniform else float(random.uniform(0.9, 1.1)),
        per_link={} if uniform else per_link,
        joint_friction_scale=float(random.uniform(0.5, 1.5)),
        ground_friction_scale=float(random.uniform(0.75, 1.25)),
        torque_scale_std=float(random.uniform(0.0, 0.04)),
        delay_ticks=int(random.integers(0, 4)),
        force_scale=float(random.uniform(*TRAINING_FORCE_SCALE_RANGE)),
        contact_offset_m=tuple(random.normal(0.0, OFF_SITE_STD_M * off_site, 3).tolist()),
        still=bool(random.random() < STILL_SHARE),
        duration_s=duration_s,
    )


def _evaluation_plan(
    index: int, split: str, seed: int, number: int, links: tuple[str, ...], duration_s: float, random: np.random.Generator
) -> RolloutPlan:
    profile = HELD_OUT_PROFILES[number % len(HELD_OUT_PROFILES)]
    kind = number // len(HELD_OUT_PROFILES) % (len(MASS_SCALES) + 1)
    per_link = _link_scales(links, random)
    uniform = kind < len(MASS_SCALES)
    return RolloutPlan(
        index=index,
        split=split,
        seed=seed,
        profile=profile,
        force_scale=EVALUATION_FORCE_SCALES[profile],
        mass_scale=MASS_SCALES[kind] if uniform else 1.0,
        per_link={} if uniform else per_link,
        joint_friction_scale=float(random.uniform(0.5, 1.5)),
        ground_friction_scale=float(random.uniform(0.75, 1.25)),
        duration_s=duration_s,
    )


def _link_scales(links: tuple[str, ...], random: np.random.Generator) -> dict[str, float]:
    return dict(zip(links, random.uniform(*PER_LINK_RANGE, len(links)).tolist(), strict=True))
