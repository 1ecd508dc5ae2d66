"""Losses that several stages of controller training share, as pure functions."""

import torch


def alignment_loss(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """``E ||E(x) - E(y)||^2`` over pairs of overlapping windows (CALM, L_align; Wang and Isola 2020).

    Args:
        first: Latents ``(n, 64)``.
        second: Latents of windows of the same clips at most 0.5 s later, ``(n, 64)``.
    """
    return (first - second).square().sum(-1).mean()


def uniformity_loss(latents: torch.Tensor, temperature: float = 2.0) -> torch.Tensor:
    """``log E_{i<j} exp(-2 ||E(x_i) - E(x_j)||^2)``, lowest if the latents are spread over the sphere (CALM, L_uniform).

    Args:
        latents: Latents of independent windows, ``(n, 64)``, n at least 2.
        temperature: The factor 2.
    """
    return torch.pdist(latents).square().mul(-temperature).exp().mean().log()


def clipped_surrogate(
    mean: torch.Tensor,
    old_mean: torch.Tensor,
    action: torch.Tensor,
    advantage: torch.Tensor,
    noise: torch.Tensor,
    clip: float,
) -> torch.Tensor:
    """PPO's loss of each sample (Schulman et al. 2017, eq. 7) for a Gaussian policy of fixed standard deviation.

    Args:
        mean: Means of the policy, ``(n, 28)``.
        old_mean: Means of the policy that acted, ``(n, 28)``.
        action: What was done, ``(n, 28)``.
        advantage: ``(n,)``.
        noise: Standard deviations, ``(28,)``.
        clip: How far the probability ratio may leave 1.

    Returns:
        Losses, ``(n,)``.
    """
    exponent = 0.5 * (((action - old_mean) / noise).square() - ((action - mean) / noise).square()).sum(-1)
    ratio = exponent.clamp(-10, 10).exp()  # the clamp: no infinity where a minibatch moves a mean far
    return -torch.minimum(ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage)
