"""The mask law: how much of a hand axis is under force control.

An axis whose mask is 0 tracks its position. One whose mask is 1 regulates its force, but only once the force asked for has
met something: until then the hand moves towards contact under velocity control. `control.whole_body.arm` blends position and
force control by this share.
"""

from control.kernels.compiled import kernel
from control.kernels.small_algebra import clip


@kernel("f8(f8, f8, f8, f8, f8)")
def force_share(mask: float, force_n: float, force_estimated_n: float, contact_share: float, contact_noise_n: float) -> float:
    """Share, 0 to 1, of force control on one axis.

        mask * clip(f_hat sign(f) / (contact_share |f| - contact_noise), 0, 1)

    Args:
        mask: 0 position, 1 force.
        force_n: f, asked for; environment on hand.
        force_estimated_n: f_hat.
        contact_share: of f that counts, estimated, as contact.
        contact_noise_n: N; a force asked for that is smaller than contact_noise / contact_share needs no contact.
    """
    needed = contact_share * abs(force_n) - contact_noise_n
    if needed <= 0.0:
        return mask
    pressed = force_estimated_n if force_n > 0.0 else -force_estimated_n
    return mask * clip(pressed / needed, 0.0, 1.0)
