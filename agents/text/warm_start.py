"""Puts what the search found into a policy: a held latent as the bias of its mean, a played clip by imitation."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents.text.candidates import Candidate, FloatArray
from agents.text.clock import with_clock
from agents.text.search import LONG_TRIAL_DECISIONS, Earnings, search, summary
from agents.text.steering import object_columns

IMITATION_EPISODE = 60
"""Decisions of an episode that is imitated: 10 s."""
IMITATION_SHARES = {"played": (0.0, 0.5), "steered": (0.0, 0.5, 0.9, 0.9)}
"""Share of the decisions that the policy takes itself in each round of imitation, by what is imitated: where an object is
walked to, what depends on its place has more to be learned."""
IMITATION_STEPS = 300
"""Gradient steps of the first round; each later round has as many more, as it has more to learn from."""
IMITATION_BATCH = 512
MOST_FALLS = 0.75
"""Share of episodes with a fall up to which a policy starts from an imitation."""


def hold(model: PPO, latent: FloatArray) -> None:
    """Makes a policy's mean a constant latent `(64,)`, up to the small output of its untrained layers."""
    with torch.no_grad():
        dict(model.policy.named_parameters())["action_net.bias"].copy_(torch.as_tensor(latent))


def record(
    env: VectorEnv, candidate: Candidate, model: PPO, share: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Plays a candidate on every humanoid, with noise on the latents and with some decisions taken by the policy.

    Both make states around the motion known, from which the imitating policy then finds back (DAgger, Ross et al. 2011).

    Args:
        env: A latent environment of n humanoids.
        candidate: What to play.
        model: The policy; the noise is that of its exploration.
        share: Share of the decisions that the policy takes.
        rng: Draws noise, decisions and start states.

    Returns:
        Observations with time `(k, 283)` and the candidate's latents `(k, 64)` at these times, terminated humanoids left out.
    """
    noise = float(model.policy.log_std.detach().exp().mean())
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    alive = np.ones(env.num_envs, bool)
    observations, latents = [], []
    columns = object_columns(env)
    for decision in range(IMITATION_EPISODE):
        timed = with_clock(observation, decision)
        latent = candidate.act(decision, observation[:, columns])
        observations.append(timed[alive])
        latents.append(latent[alive])
        own, _ = model.predict(timed, deterministic=True)
        actions = np.where(rng.uniform(size=(env.num_envs, 1)) < share, own, latent)
        actions = actions + rng.normal(0.0, noise, actions.shape)
        observation, _, terminated, _, _ = env.step(np.clip(actions, -1.0, 1.0).astype(np.float32))
        alive &= ~terminated
        if not alive.any():
            break
    return np.concatenate(observations), np.concatenate(latents)


def imitate(
    model: PPO,
    observations: FloatArray,
    latents: FloatArray,
    rng: np.random.Generator,
    steps: int = IMITATION_STEPS,
) -> float:
    """Fits the policy's mean action to latents by least squares.

    Args:
        model: The model; an optimiser of its own is used, so PPO's is untouched.
        observations: `(k, 283)`.
        latents: `(k, 64)`.
        rng: Draws minibatches.
        steps: Gradient steps.

    Returns:
        Mean squared error, summed over the 64 numbers, in the last tenth of the steps.
    """
    policy = model.policy
    mean = torch.nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
    optimiser = torch.optim.Adam(mean.parameters(), lr=1e-3)
    inputs, wanted = torch.as_tensor(observations), torch.as_tensor(latents)
    errors = []
    for _ in range(steps):
        rows = torch.as_tensor(rng.integers(len(inputs), size=IMITATION_BATCH))
        error = (mean(inputs[rows]) - wanted[rows]).square().sum(-1).mean()
        optimiser.zero_grad()
        error.backward()
        optimiser.step()
        errors.append(float(error.detach()))
    return float(np.mean(errors[-steps // 10 :]))


def policy_earnings(env: VectorEnv, model: PPO, alive_bonus: float, rng: np.random.Generator) -> Earnings:
    """What the deterministic policy earns in a whole episode, counted as the search counts it."""
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    earnings = Earnings(env.num_envs, alive_bonus)
    for decision in range(LONG_TRIAL_DECISIONS):
        action, _ = model.predict(with_clock(observation, decision), deterministic=True)
        observation, reward, terminated, _, _ = env.step(action)
        earnings.add(reward, terminated)
    return earnings


def warm_start(
    model: PPO,
    env: VectorEnv,
    latents: FloatArray,
    names: NDArray[np.str_],
    alive_bonus: float,
    seed: int,
    seconds: float = np.inf,
) -> dict[str, Any]:
    """Lets a policy start from what the search finds.

    What is played or steered and earns more than the best held latent is imitated. If the imitation then earns less than
    the held latent while it is up, or falls in more than three of four episodes, the policy holds the latent after all. A
    few falls do not count against it: PPO unlearns them sooner than it would find the motion.

    Args:
        model: An untrained model.
        env: A latent environment with the reward of training.
        latents: The library's latents, `(k, 64)`.
        names: The clip of each, `(k,)`.
        alive_bonus: Bonus of training for a decision without a fall.
        seed: Seed of everything that is drawn.
        seconds: No new round of the search begins after this time.

    Returns:
        What the report says about it.
    """
    rng = np.random.default_rng(seed)
    result = search(env, latents, names, alive_bonus, rng, seconds=seconds)
    report = summary(result)
    start, reward = "held", result.held.reward
    courses = {"played": result.played, "steered": result.steered}
    kind, course = max(courses.items(), key=lambda item: item[1].reward if item[1] else -np.inf)
    untrained = {name: value.clone() for name, value in model.policy.state_dict().items()}
    if course is not None and course.reward > result.held.reward:
        recorded: list[tuple[FloatArray, FloatArray]] = []
        error = np.inf
        for share in IMITATION_SHARES[kind]:
            recorded.append(record(env, course, model, share, rng))
            observations, wanted = (np.concatenate(arrays) for arrays in zip(*recorded, strict=True))
            error = imitate(model, observations, wanted, rng, IMITATION_STEPS * len(recorded))
        imitated = policy_earnings(env, model, alive_bonus, rng)
        falls = float(1.0 - imitated.alive.mean())
        report["imitation"] = {"reward_while_up": imitated.mean_while_up, "falls": falls, "squared_error": error}
        if imitated.mean_while_up > result.held.reward and falls <= MOST_FALLS:
            start, reward = kind, float(imitated.means().mean())
        else:
            model.policy.load_state_dict(untrained)
    if start == "held":
        hold(model, result.held.latents[0])
    with torch.no_grad():
        # The value of earning this for ever (as agents.text.shaping scales it), which by gradient descent it would take
        # the first updates to find.
        dict(model.policy.named_parameters())["value_net.bias"].fill_(reward + alive_bonus)
    return report | {"start": start, "reward": reward}
