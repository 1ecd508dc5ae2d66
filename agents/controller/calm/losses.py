"""The losses and the reward of adversarial imitation, as pure functions.

Equations are those of AnySkill (Cui et al., CVPR 2024) where they have a number, else of CALM (Tessler et al. 2023).
Where the paper and the released code disagree, `docs/calm.md` says what is computed here.
"""

from collections.abc import Collection, Iterable
from typing import Literal

import torch
from torch import nn

Term = Literal["real", "fake", "mismatched"]
LossForm = Literal["equation", "released"]
TERMS: tuple[Term, ...] = ("real", "fake", "mismatched")
"""The three terms of AnySkill's eq. 1."""


def discriminator_loss(
    real: torch.Tensor,
    fake: torch.Tensor,
    mismatched: torch.Tensor,
    terms: Collection[Term] = TERMS,
    form: LossForm = "equation",
) -> torch.Tensor:
    """Classification part of the conditional discriminator's loss (AnySkill, eq. 1, without the gradient penalty).

    With D the sigmoid of a logit, "equation" is, all three terms under one minus sign,

        -E[log D(real | z)] - E[log(1 - D(fake | z))] - E[log(1 - D(real | z'))],

    and "released" pools everything that should be judged 0, as the code of CALM and AnySkill does:

        0.5 * (-E[log D(real | z)] - E_pooled[log(1 - D(fake | z)), log(1 - D(real | z'))]).

    The released configurations leave "mismatched" out, which makes the loss binary.

    Args:
        real: Logits of the reference's transitions under their own latents, ``(a,)``.
        fake: Logits of the policy's transitions under the latents it followed, ``(b,)``.
        mismatched: Logits of transitions under other latents, ``(c,)``.
        terms: Which terms count.
        form: How they are added up.

    Returns:
        The loss, a scalar.

    Raises:
        ValueError: If a term is unknown or there is none.
    """
    unknown = set(terms) - set(TERMS)
    if unknown or not terms:
        raise ValueError(
            f"The loss has the terms {', '.join(TERMS)}; choose at least one of them, got {sorted(terms)}."
        )
    # -log(1 - sigmoid(x)) = softplus(x) and -log sigmoid(x) = softplus(-x), without overflow.
    own = nn.functional.softplus(-real).mean() if "real" in terms else real.new_zeros(())
    others = [logits for name, logits in (("fake", fake), ("mismatched", mismatched)) if name in terms]
    if form == "released":
        pooled = nn.functional.softplus(torch.cat(others)).mean() if others else real.new_zeros(())
        return 0.5 * (own + pooled)
    return own + sum((nn.functional.softplus(logits).mean() for logits in others), real.new_zeros(()))


def gradient_penalty(logits: torch.Tensor, *inputs: torch.Tensor) -> torch.Tensor:
    """Mean squared norm of the gradient of each logit with respect to its own inputs (eq. 1, last term).

    Args:
        logits: Outputs, ``(n,)``; row i may depend on row i of the inputs only.
        inputs: What they were computed from, each ``(n, ...)`` and requiring gradients.

    Returns:
        ``E[sum_inputs ||d logit / d input||^2]``, a scalar that can be differentiated again.
    """
    gradients = torch.autograd.grad(logits.sum(), inputs, create_graph=True)
    return torch.stack([gradient.flatten(1).square().sum(1) for gradient in gradients]).sum(0).mean()


def squared_weights(modules: Iterable[nn.Module]) -> torch.Tensor:
    """Sum of the squared weights (not biases) of all linear layers among ``modules``, a scalar."""
    return torch.stack([module.weight.square().sum() for module in modules if isinstance(module, nn.Linear)]).sum()


def style_reward(logits: torch.Tensor, scale: float = 1.0, floor: float = 1e-4) -> torch.Tensor:
    """Reward for looking real under the latent: ``-scale * log(1 - D(s, s' | z))`` (AnySkill, eq. 2).

    Args:
        logits: Of the policy's transitions, ``(...)``.
        scale: 1 in the paper, 2 in the released code.
        floor: Least value of ``1 - D`` (released code): the reward is at most ``-scale * log(floor)``, 9.2 by default.

    Returns:
        Rewards, the same shape, from 0 up.
    """
    return -scale * torch.sigmoid(-logits).clamp_min(floor).log()


def bound_loss(mean: torch.Tensor, centre: torch.Tensor, reach: torch.Tensor) -> torch.Tensor:
    """How far each sample's mean target leaves the range of targets: sum of squares beyond ±1 (released code).

    Args:
        mean: Mean targets in radians, ``(n, 28)``.
        centre: Middle of the range, ``(28,)``.
        reach: Half of the range, ``(28,)``; excess is counted in this unit.

    Returns:
        Losses, ``(n,)``.
    """
    return (((mean - centre) / reach).abs() - 1).clamp_min(0).square().sum(-1)
