"""The three force networks: what each sees, what it corrects, and how it is trained."""

from dataclasses import dataclass

from control.estimation.networks.force_features import HYBRID_GROUPS, HYBRID_INCREMENT_GROUPS, PAPER_GROUPS


@dataclass(frozen=True, slots=True)
class TrainingTarget:
    """One network to train.

    Attributes:
        name: of the estimator.
        feature_groups: inputs.
        increment_groups: those that are seen as changes from the step before.
        nominal: estimator whose force it corrects, None to give the whole force.
        features_from: nominal estimator that the nominal_* features come from.
        gaussian: output mean and variance, trained by their likelihood without each rollout's bias
            (control.learning.rollout_bias); else the mean alone, by the Smooth-L1 loss.
        shrinks: the correction is shrunk as far as validation asks for (control.learning.shrinkage).
    """

    name: str
    feature_groups: tuple[str, ...]
    increment_groups: tuple[str, ...]
    nominal: str | None
    features_from: str
    gaussian: bool
    shrinks: bool = False


TARGETS = {
    target.name: target
    for target in (
        TrainingTarget("tcn", PAPER_GROUPS, (), None, "adaptive", gaussian=False),
        TrainingTarget("hybrid_paper", PAPER_GROUPS, (), "gmo_cqp", "gmo_cqp", gaussian=False),
        TrainingTarget("hybrid", HYBRID_GROUPS, HYBRID_INCREMENT_GROUPS, "adaptive", "adaptive", gaussian=True, shrinks=True),
    )
}
"""`tcn` and `hybrid_paper` are the paper's (Sec. III.B): same network, loss and data; only the target differs."""
