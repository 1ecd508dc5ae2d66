"""Trains state and text towers together."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional
from torch.optim.swa_utils import AveragedModel
from tqdm import tqdm

from agents.encoder.captions import Caption, CaptionSet, joint_truth
from agents.encoder.config import EncoderConfig
from agents.encoder.dataset import FILM_FRAMES, MotionSet
from agents.encoder.material import mirrored_concepts
from agents.encoder.networks import StateTower, TextHead
from agents.encoder.posecodes.grading import CodeChooser, grade, opposites
from agents.encoder.posecodes.lessons import compose, with_one_wrong, write_lessons, write_phrases
from agents.encoder.sampling import CaptionSampler, MotionSampler, concept_weights
from agents.encoder.scenes import ObjectLayout
from agents.encoder.token_states import TokenStore
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN
from motion_data.files import write_whole
from rewards.clauses import split_clauses

log = logging.getLogger(__name__)

_AVERAGED_STEPS = 1000
"""Steps that the running mean of the weights reaches back at most, or the last fifth of fewer."""
_CLAUSES_AT_ONCE = 192


def grading_loss(
    similarity: Tensor, truth: Tensor, scale: Tensor, bias: Tensor, counted: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """How badly similarities grade.

    The first part is a sigmoid loss over all pairs of motion and caption (Zhai et al. 2023), with graded targets: no true
    pair is ever a negative. The second is one minus the correlation of similarity and truth over the motions, for each
    caption: what a policy that climbs the similarity cares for.

    Args:
        similarity: cosines, `(n, c)`.
        truth: from 0 to 1, `(n, c)`.
        scale: factor of the cosine in the logit.
        bias: offset of the logit.
        counted: over which motions the correlation of each caption is taken, `(n, c)` of 0 and 1; all if None. For captions
            about an object those of scenes with it: that it is there would else be most of what is learned.

    Returns:
        Both parts.
    """
    pairs = functional.binary_cross_entropy_with_logits(similarity * scale + bias, truth, weight=1.0 + 3.0 * truth)
    counted = torch.ones_like(truth) if counted is None else counted
    number = counted.sum(0).clamp(min=1.0)
    centred = (similarity - (similarity * counted).sum(0) / number) * counted
    wanted = (truth - (truth * counted).sum(0) / number) * counted
    spread = wanted.norm(dim=0)
    correlation = (centred * wanted).sum(0) / (centred.norm(dim=0) * spread + 1e-4)
    counts = (spread > 0.5).float()
    return pairs, ((1.0 - correlation) * counts).sum() / counts.sum().clamp(min=1.0)


def _without_some(mask: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Hides one token state in twelve, never all: the text tower must not hang on one of them."""
    hidden = mask * (rng.random(mask.shape) > 1 / 12)
    return np.where(hidden.sum(1, keepdims=True) > 0, hidden, mask).astype(np.float32)


def learning_rate_at(step: int, steps: int, highest: float) -> float:
    """Rises for 200 steps, then falls along a cosine."""
    return float(highest * min(1.0, (step + 1) / 200) * 0.5 * (1.0 + np.cos(np.pi * min(1.0, step / steps))) + 1e-6)


@torch.no_grad()
def _running_mean(
    averaged: tuple[Tensor, ...] | list[Tensor], current: tuple[Tensor, ...] | list[Tensor], count: Tensor | int
) -> None:
    """Moves running means towards the weights after `count` updates."""
    share = max(1.0 / _AVERAGED_STEPS, 5.0 / (int(count) + 5.0))
    for mean, value in zip(averaged, current, strict=True):
        mean.lerp_(value, share)


@dataclass
class Towers:
    """State and text towers with the logit's scale and bias."""

    state: StateTower
    text: TextHead
    logit: nn.ParameterDict


def input_scales(motions: MotionSet, layout: ObjectLayout) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mean and scale of the inputs of the state tower, `(223 + m,)`.

    Zero stays zero for objects: it says that there is none. Their scale is that of the scenes in which they are.
    """
    both = np.concatenate([motions.observations, motions.observations[:, MIRROR_INDEX] * MIRROR_SIGN])
    mean, scale = both.mean(0), np.maximum(both.std(0), 0.02)
    spread = np.ones(layout.size)
    start = 0
    for size in layout.sizes.values():
        block = motions.objects[motions.objects[:, start] > 0, start : start + 1 + size]
        if len(block):
            spread[start : start + 1 + size] = np.maximum(np.sqrt((block**2).mean(0)), 0.05)
        start += 1 + size
    return (
        np.concatenate([mean, np.zeros(layout.size)]).astype(np.float32),
        np.concatenate([scale, spread]).astype(np.float32),
    )


def build_towers(config: EncoderConfig, motions: MotionSet, layout: ObjectLayout) -> Towers:
    """Untrained towers, normalised to the motions."""
    torch.manual_seed(config.seed)
    state = StateTower(*input_scales(motions, layout), config.feature_size // 2, config.hidden)
    first = {"scale": 10.0, "bias": -3.0} | ({"retrieval": 15.0} if config.lessons else {})
    logit = nn.ParameterDict({name: nn.Parameter(torch.tensor(value)) for name, value in first.items()})
    return Towers(state, TextHead(config.feature_size // 2), logit)


class _Lessons:
    """Draws motions and captions about posecodes for each step."""

    def __init__(self, config: EncoderConfig, motions: MotionSet, sampler: MotionSampler) -> None:
        self.rng = np.random.default_rng(config.seed + 5)
        self.sampler = sampler
        self.size = config.lesson_batch
        log.info("grading posecodes of %d motions", len(motions))
        self.chooser = CodeChooser(grade(motions.films, FILM_FRAMES), self.rng)
        rows = sampler.index(config.lessons)
        self.lessons = write_lessons(self.chooser, rows, sampler.turned(rows), self.rng)
        self.phrases = write_phrases(self.rng, config.phrases)
        self.confused = opposites()

    @property
    def texts(self) -> list[str]:
        """All texts that captions are made of."""
        told = [text for one in self.lessons for text in (one.text, one.other_text, one.wrong_text)]
        return told + [text for texts in self.phrases for text in texts]

    def draw(self) -> tuple[_LessonBatch, NDArray[np.int64], NDArray[np.bool_]]:
        """Captions, and the motions that they are about: first those of lessons, then those of composed captions."""
        chosen = [self.lessons[index] for index in self.rng.integers(len(self.lessons), size=self.size)]
        other = self.sampler.index(self.size)
        rows = np.concatenate([[one.row for one in chosen], other]).astype(np.int64)
        turned = np.concatenate([[one.turned for one in chosen], self.sampler.turned(other)]).astype(bool)
        grades = self.chooser.of(other, turned[self.size :])
        facts = [one or (0,) for one in self.chooser.choose(grades)]
        wrong = [with_one_wrong(one, grade, self.confused, self.rng) for one, grade in zip(facts, grades, strict=True)]
        right_words = [compose(one, self.phrases, self.rng) for one in facts]
        other_words = [compose(one, self.phrases, self.rng) for one in facts]
        wrong_words = [compose(one, self.phrases, self.rng, like) for one, like in zip(wrong, right_words, strict=True)]
        captions = [
            *(split_clauses(one.text) for one in chosen),
            *self._said(facts, right_words),
            *(split_clauses(one.other_text) for one in chosen),
            *self._said(facts, other_words),
            *(split_clauses(one.wrong_text) for one in chosen),
            *self._said(wrong, wrong_words),
        ]
        true_facts = [one.facts for one in chosen] + facts
        wrong_facts = [one.wrong_facts for one in chosen] + wrong
        differs = np.array([one != other for one, other in zip(true_facts, wrong_facts, strict=True)])
        return _LessonBatch(captions, true_facts * 2 + wrong_facts, differs), rows, turned

    def _said(self, facts: Sequence[tuple[int, ...]], words: Sequence[list[int]]) -> list[list[str]]:
        """Clauses of captions that are composed of one phrase for each fact."""
        return [
            [clause for fact, word in zip(*one, strict=True) for clause in split_clauses(self.phrases[fact][word])]
            for one in zip(facts, words, strict=True)
        ]


@dataclass(frozen=True)
class _LessonBatch:
    """Captions of one step as lists of clauses: right ones, the same in other words, wrong ones; a third each.

    Each third begins with those of lessons, and goes on with composed ones. `demands` are their facts; `differs` says for which
    of the right ones there is a wrong one.
    """

    captions: list[list[str]]
    demands: list[tuple[int, ...]]
    differs: NDArray[np.bool_]


def caption_features(
    head: TextHead, store: TokenStore, captions: Sequence[Sequence[str]], rng: np.random.Generator
) -> Tensor:
    """Unit features of captions `(k, d)`: of each the normalised sum of its clauses, which are read alone.

    Args:
        head: the text tower.
        store: token states of the clauses.
        captions: the clauses of each.
        rng: hides token states.
    """
    clauses = sorted(
        {clause for caption in captions for clause in caption}, key=lambda text: (store.length(text), text)
    )
    place = {clause: row for row, clause in enumerate(clauses)}
    features = []
    for start in range(0, len(clauses), _CLAUSES_AT_ONCE):  # short and long ones apart: there is less padding
        states, mask = store.batch(clauses[start : start + _CLAUSES_AT_ONCE])
        features.append(head(torch.from_numpy(states), torch.from_numpy(_without_some(mask, rng))).float())
    rows = torch.tensor([place[clause] for caption in captions for clause in caption])
    owners = torch.repeat_interleave(torch.arange(len(captions)), torch.tensor([len(one) for one in captions]))
    sums = torch.zeros(len(captions), features[0].shape[1]).index_add(0, owners, torch.cat(features)[rows])
    return functional.normalize(sums, dim=-1)


def lesson_loss(similarity: Tensor, truth: Tensor, text: Tensor, differs: Tensor, scale: Tensor) -> Tensor:
    """What lessons ask for beside the grades.

    A caption finds the motions of which it is most true among all of the batch: cross-entropy of a softmax over the motions
    (Radford et al. 2021) with the softmax of the truths as target, so that motions of which it is as true share. Two
    wordings of the same facts have one feature. The caption with one fact wrong is further from its motion than the right one.

    Args:
        similarity: cosines, `(n, 3 k)`; captions: k right ones, k in other words, k wrong ones. The last k motions are
            those that they are about.
        truth: `(n, 3 k)`.
        text: features of the captions, `(3 k, d)`.
        differs: for which lessons there is a wrong one, `(k,)`.
        scale: factor of the cosine in the softmax.
    """
    count = len(differs)
    target = torch.softmax(truth * 12.0, dim=0)
    weight = ((truth.max(0).values - 0.5) * 2.0).clamp(0.0, 1.0)
    found = -(target * torch.log_softmax(similarity * scale, dim=0)).sum(0)
    # The least possible: the entropy of the target.
    least = -(target * torch.log(target + 1e-12)).sum(0)
    retrieval = ((found - least) * weight).sum() / weight.sum().clamp(min=1.0)
    same = 1.0 - (text[:count] * text[count : 2 * count]).sum(1).mean()
    rows = torch.arange(count)
    own = len(similarity) - count + rows
    right, wrong = similarity[own, rows], similarity[own, 2 * count + rows]
    margin = functional.softplus(15.0 * (wrong - right) + 1.0)
    told_apart = (margin * differs).sum() / differs.sum().clamp(min=1.0)
    return 0.4 * retrieval + 0.5 * same + 0.3 * told_apart


def widened(earlier: dict[str, Tensor], modules: nn.ModuleDict) -> dict[str, Tensor]:
    """Weights of an earlier training in towers that may have wider hidden layers, without a change of what they compute.

    New hidden units keep their random weights towards the inputs; nothing listens to them at first.

    Args:
        earlier: state of the earlier modules; what the new ones have beside it stays as it is.
        modules: the new towers.
    """
    weights = {name: value.clone() for name, value in modules.state_dict().items()}
    for name, value in earlier.items():
        own = weights[name]
        if own.dim() == 2 and own.shape[1] > value.shape[1]:
            own[: value.shape[0], value.shape[1] :] = 0.0
        own[tuple(slice(0, size) for size in value.shape)] = value
    return weights


def about_what_is_there(
    chosen: Sequence[Caption], captions: CaptionSet, objects: NDArray[np.float32], layout: ObjectLayout
) -> NDArray[np.float32]:
    """Which motions have the objects that captions speak of, `(n, c)` of 0 and 1; captions about none count everywhere."""
    there = {name: layout.there(name, objects) for name in layout.names}
    counted = np.ones((len(objects), len(chosen)), np.float32)
    for column, caption in enumerate(chosen):
        for concept in caption.concepts:
            kind = captions.concepts[concept].name.partition(":")[0]
            if kind in there:
                counted[:, column] *= there[kind]
    return counted


def train_towers(
    config: EncoderConfig, motions: MotionSet, captions: CaptionSet, layout: ObjectLayout, tokens_path: Path
) -> Towers:
    """Trains state and text towers together.

    Args:
        config: settings.
        motions: training motions.
        captions: captions.
        layout: objects that the motions' scenes hold.
        tokens_path: where the token states of the captions are kept.

    Returns:
        The towers with the running mean of the weights over the last thousand steps or so, which understands foreign words
        better than the last weights do; the last checkpoint is `towers.pt` in the run folder.
    """
    towers = build_towers(config, motions, layout)
    mirror = mirrored_concepts(captions.concepts)
    weights = concept_weights(captions.concepts, config.relation_share)
    sampler = MotionSampler(motions, mirror, np.random.default_rng(config.seed + 1), layout, weights)
    caption_sampler = CaptionSampler(captions, np.random.default_rng(config.seed + 2))
    lessons = _Lessons(config, motions, sampler) if config.lessons else None
    texts = [caption.text for caption in captions.training] + (lessons.texts if lessons is not None else [])
    store = TokenStore([clause for text in texts for clause in split_clauses(text)], tokens_path)
    modules = nn.ModuleDict({"state": towers.state, "text": towers.text, "logit": towers.logit})
    averaged = AveragedModel(modules, multi_avg_fn=_running_mean)
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=1e-3)
    checkpoint = config.run / "towers.pt"
    first = 0
    if config.begin is not None and not checkpoint.is_file():
        earlier = torch.load(config.begin / "towers.pt", weights_only=True)
        modules.load_state_dict(widened(earlier["averaged"], modules))
    if checkpoint.is_file():
        stored = torch.load(checkpoint, weights_only=True)
        modules.load_state_dict(stored["modules"])
        averaged.module.load_state_dict(stored["averaged"])
        optimiser.load_state_dict(stored["optimiser"])
        first = int(stored["step"])
        averaged.n_averaged.fill_(first)
    progress = tqdm(range(first, config.steps), desc="state and text towers", initial=first, total=config.steps)
    modules.train()
    saved = time.monotonic()
    for step in progress:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate_at(step, config.steps, config.learning_rate)
        index = sampler.index(config.state_batch)
        turned = sampler.turned(index)
        chosen = [captions.training[place] for place in caption_sampler.draw(config.caption_batch)]
        clauses = [split_clauses(caption.text) for caption in chosen]
        if lessons is not None:
            lesson, rows, mirrored = lessons.draw()
            index, turned = np.concatenate([index, rows]), np.concatenate([turned, mirrored])
            clauses += lesson.captions
        observations, objects, truths = sampler.take(index, turned)
        truth = torch.from_numpy(captions.truth(chosen, truths))
        with torch.autocast("cpu", dtype=torch.bfloat16):
            features = caption_features(towers.text, store, clauses, sampler.rng)
            state = towers.state(torch.from_numpy(observations), torch.from_numpy(objects))
        state = state.float()
        text = features[: len(chosen)]
        counted = torch.from_numpy(about_what_is_there(chosen, captions, objects, layout))
        pairs, order = grading_loss(state @ text.T, truth, towers.logit["scale"], towers.logit["bias"], counted)
        loss = pairs + order
        if lessons is not None:
            told = features[len(chosen) :]
            facts = torch.from_numpy(joint_truth(lesson.demands, lessons.chooser.of(index, turned)))
            similarity = state @ told.T
            fact_pairs, fact_order = grading_loss(similarity, facts, towers.logit["scale"], towers.logit["bias"])
            asked = lesson_loss(similarity, facts, told, torch.from_numpy(lesson.differs), towers.logit["retrieval"])
            loss = loss + fact_pairs + fact_order + asked
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(modules.parameters(), 1.0)
        optimiser.step()
        averaged.update_parameters(modules)
        if step % 50 == 0:
            shown = {"pairs": f"{pairs.item():.3f}", "correlation": f"{1 - order.item():.3f}"}
            if lessons is not None:
                shown |= {"facts": f"{1 - fact_order.item():.3f}", "lessons": f"{asked.item():.3f}"}
            progress.set_postfix(shown)
        if time.monotonic() - saved > 60 or step + 1 == config.steps:
            saved = time.monotonic()
            stored = {
                "modules": modules.state_dict(),
                "averaged": averaged.module.state_dict(),
                "optimiser": optimiser.state_dict(),
                "step": step + 1,
            }
            write_whole(checkpoint, partial(torch.save, stored))
    modules.load_state_dict(averaged.module.state_dict())
    modules.eval()
    return towers
