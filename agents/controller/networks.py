"""Small networks shared by the stages of controller training."""

from collections.abc import Sequence

import torch
from torch import nn


def mlp(sizes: Sequence[int], final_scale: float | None = None) -> nn.Sequential:
    """A multilayer perceptron with SiLU between its layers.

    Args:
        sizes: Widths from input to output.
        final_scale: Factor on the last layer's initial weights; None leaves them.
    """
    layers: list[nn.Module] = []
    for first, second in zip(sizes[:-1], sizes[1:], strict=True):
        layers += [nn.Linear(first, second), nn.SiLU()]
    network = nn.Sequential(*layers[:-1])
    if final_scale is not None:
        last = network[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(final_scale)
            last.bias.zero_()
    return network


class Normalizer(nn.Module):
    """Running mean and standard deviation of inputs, clipped to +-5 standard deviations.

    Args:
        size: Numbers per input.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, size: int):
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(()))

    def update(self, inputs: torch.Tensor, limit: float = 3e6) -> None:
        """Takes a batch ``(n, size)`` into account; after ``limit`` samples the statistics stay as they are."""
        if self.count >= limit:
            return
        total = self.count + len(inputs)
        variance, mean = torch.var_mean(inputs, 0, correction=0)
        share = len(inputs) / total
        delta = mean - self.mean
        self.variance.copy_((1 - share) * self.variance + share * variance + share * (1 - share) * delta**2)
        self.mean.add_(share * delta)
        self.count.copy_(total)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Normalised inputs, same shape."""
        return ((inputs - self.mean) * torch.rsqrt(self.variance + 1e-3)).clamp(-5, 5)


def fast_arithmetic() -> torch.autocast:
    """bfloat16 where it is safe: faster than float32 on CPUs that have instructions for it."""
    return torch.autocast("cpu", torch.bfloat16)
