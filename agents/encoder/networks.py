"""The three towers of the bundled encoder; each ends in unit vectors of the shared space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from rewards.minilm import TOKEN_SIZE


class StateTower(nn.Module):
    """Observation, and states of objects where it knows any, to feature: the state projection.

    Args:
        mean: mean of each input number, `(223,)`, or `(223 + m,)` with m numbers about objects.
        scale: its standard deviation, of the same shape.
        feature_size: size of the shared space.
        hidden: width of both hidden layers.
    """

    def __init__(
        self, mean: NDArray[np.float32], scale: NDArray[np.float32], feature_size: int, hidden: int = 512
    ) -> None:
        super().__init__()
        self.mean: Tensor
        self.inverse_scale: Tensor
        self.register_buffer("mean", torch.as_tensor(mean))
        self.register_buffer("inverse_scale", 1.0 / torch.as_tensor(scale))
        self.layers = nn.Sequential(
            nn.Linear(len(mean), hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, feature_size),
        )

    def forward(self, observation: Tensor, objects: Tensor | None = None) -> Tensor:
        """Unit features `(n, d)` of observations `(n, 223)` and states of objects `(n, m)`."""
        x = observation if objects is None else torch.cat([observation, objects], dim=1)
        x = ((x - self.mean) * self.inverse_scale).clamp(-6.0, 6.0)
        return functional.normalize(self.layers(x).float(), dim=-1)


def mirror_image(x: Tensor, index: Tensor, sign: Tensor, sided: Sequence[int]) -> Tensor:
    """Inputs `(n, k)` of a state tower in the mirror; see :class:`MirroredStateTower`."""
    mirrored = x[:, index] * sign
    if not sided:
        return mirrored
    return torch.where((x[:, list(sided)] > 0).any(1, keepdim=True), x, mirrored)


class MirroredStateTower(nn.Module):
    """A state tower that looks at each state twice: as it is, and in the mirror.

    Its feature is that of the state and that of its mirror image, side by side. Compared with the features of a text and of
    that text with left and right exchanged, a text is exactly as true of a motion as the exchanged text is of the motion in
    the mirror; and two looks are less often wrong than one.

    Args:
        tower: the tower.
        index: which input number each number of the mirror image is, `(k,)`.
        sign: its sign, `(k,)`.
        sided: columns of the input that are 1 where an object stands that is another one in the mirror; such scenes are seen
            as they are twice.
    """

    def __init__(
        self, tower: StateTower, index: NDArray[np.int64], sign: NDArray[np.float32], sided: Sequence[int] = ()
    ) -> None:
        super().__init__()
        self.tower = tower
        self.index: Tensor
        self.sign: Tensor
        self.register_buffer("index", torch.as_tensor(index))
        self.register_buffer("sign", torch.as_tensor(sign))
        self.sided = list(sided)

    def forward(self, observation: Tensor, objects: Tensor | None = None) -> Tensor:
        """Unit features `(n, 2 d)` of observations `(n, 223)` and states of objects `(n, m)`."""
        x = observation if objects is None else torch.cat([observation, objects], dim=1)
        mirrored = mirror_image(x, self.index, self.sign, self.sided)
        return torch.cat([self.tower(x), self.tower(mirrored)], dim=1) * 0.5**0.5


class SymmetricStateTower(nn.Module):
    """A student of :class:`MirroredStateTower` that costs about as much as one look, and is as symmetric.

    Hidden numbers come in pairs: for the state as it is, and for its mirror image. Layers treat both alike, so that in the
    mirror the partners change places, and so do the halves of the feature, exactly.

    Args:
        teacher: the tower to learn from.
        feature_size: size of the shared space, of both halves.
        hidden: width of both hidden layers, of both partners.
    """

    def __init__(self, teacher: MirroredStateTower, feature_size: int, hidden: int) -> None:
        super().__init__()
        self.mean: Tensor
        self.inverse_scale: Tensor
        self.index: Tensor
        self.sign: Tensor
        for name in ("mean", "inverse_scale"):
            self.register_buffer(name, getattr(teacher.tower, name).clone())
        for name in ("index", "sign"):
            self.register_buffer(name, getattr(teacher, name).clone())
        self.sided = teacher.sided
        half, outputs = hidden // 2, feature_size // 2
        self.first = nn.Linear(len(teacher.index), half)
        self.second = _PairedLinear(half, half)
        self.last = _PairedLinear(half, outputs)

    def forward(self, observation: Tensor, objects: Tensor | None = None) -> Tensor:
        """Unit features `(n, d)` of observations `(n, 223)` and states of objects `(n, m)`."""
        x = observation if objects is None else torch.cat([observation, objects], dim=1)
        mirrored = mirror_image(x, self.index, self.sign, self.sided)
        looks = [((look - self.mean) * self.inverse_scale).clamp(-6.0, 6.0) for look in (x, mirrored)]
        hidden = torch.relu(torch.cat([self.first(look) for look in looks], dim=1))
        hidden = torch.relu(self.second(hidden))
        return functional.normalize(self.last(hidden).float(), dim=-1)


class _PairedLinear(nn.Module):
    """A linear layer of pairs `(n, 2 k)`, all first partners and then all second ones, that treats both alike."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.own = nn.Linear(inputs, outputs)
        self.partner = nn.Linear(inputs, outputs, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        own, partner = self.own.weight, self.partner.weight
        # One product for both; the exported file holds the weights put together.
        weight = torch.cat([torch.cat([own, partner], 1), torch.cat([partner, own], 1)], 0)
        return functional.linear(x, weight, self.own.bias.repeat(2))


class TextHead(nn.Module):
    """Token states of the frozen sentence model to feature: pooling by learned attention, then a small network.

    Args:
        feature_size: size of the shared space.
        heads: how many weighted means of the tokens are taken.
        width: numbers per weighted mean.
    """

    def __init__(self, feature_size: int, heads: int = 8, width: int = 64, hidden: int = 512) -> None:
        super().__init__()
        self.heads, self.width = heads, width
        self.normalise = nn.LayerNorm(TOKEN_SIZE)
        self.values = nn.Linear(TOKEN_SIZE, heads * width)
        self.scores = nn.Sequential(nn.Linear(TOKEN_SIZE, 128), nn.ReLU(), nn.Linear(128, heads))
        self.layers = nn.Sequential(
            nn.ReLU(), nn.Dropout(0.1), nn.Linear(heads * width, hidden), nn.ReLU(), nn.Linear(hidden, feature_size)
        )

    def forward(self, tokens: Tensor, mask: Tensor) -> Tensor:
        """Unit features `(k, d)` of token states `(k, tokens, 384)`; the mask `(k, tokens)` is 0 for padding."""
        x = self.normalise(tokens)
        scores = self.scores(x) + (mask[..., None] - 1.0) * 1e4
        weights = torch.softmax(scores.float(), dim=1)
        values = self.values(x).reshape(x.shape[0], x.shape[1], self.heads, self.width)
        pooled = (weights[..., None] * values).sum(1).flatten(1)
        return functional.normalize(self.layers(pooled).float(), dim=-1)


class ImageTower(nn.Module):
    """Short films of four frames of 64 x 64 pixels to feature.

    Each frame goes through the same convolutions; the frames are then read in their order.

    Args:
        feature_size: size of the shared space.
        frames: frames of a film.
    """

    def __init__(self, feature_size: int, frames: int = 4, width: int = 24, size: int = 64) -> None:
        super().__init__()
        self.frames = frames
        channels = [3, width, 2 * width, 4 * width, 6 * width]
        layers: list[nn.Module] = []
        for inputs, outputs in zip(channels[:-1], channels[1:], strict=True):
            layers += [nn.Conv2d(inputs, outputs, 3, stride=2, padding=1), nn.BatchNorm2d(outputs), nn.ReLU()]
        self.convolutions = nn.Sequential(*layers)
        spot = size // 2 ** (len(channels) - 1)
        self.frame_layer = nn.Linear(channels[-1] * spot * spot, 256)
        self.layers = nn.Sequential(nn.ReLU(), nn.Linear(256 * frames, 512), nn.ReLU(), nn.Linear(512, feature_size))

    def forward(self, films: Tensor) -> Tensor:
        """Unit features `(n, d)` of films `(n, frames, size, size, 3)` with values from 0 to 255."""
        count, frames = films.shape[0], films.shape[1]
        pictures = films.flatten(0, 1).permute(0, 3, 1, 2).float() / 127.5 - 1.0
        x = self.frame_layer(self.convolutions(pictures).flatten(1))
        x = x.reshape(count, frames * x.shape[-1])
        return functional.normalize(self.layers(x).float(), dim=-1)
