"""Hosts a PettingZoo ParallelEnv for a swarm whose agents are processes.

    vamaro-swarm spawn --env 'python3 -m vamaro_swarm.serve mpe2.simple_spread_v3 N=4' ..

The first word is a module with a function `parallel_env`, or `module:function`. The others are arguments of that function,
as Python writes them. See docs/python.md; docs/protocol.md has what is sent.
"""

from __future__ import annotations

import argparse
import ast
import json
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from gymnasium import spaces

from . import values
from ._native import Host
from .errors import AgentError, Error
from .links import LossyLinks

#: Steps after which an episode must be over, if nobody says how long episodes are.
_MAX_STEPS = 10_000

_OPEN, _TERMINATED, _TRUNCATED = 0, 1, 2


class World:
    """One of the worlds that are hosted: an environment and its episode."""

    def __init__(self, env: Any, horizon: int | None) -> None:
        # Links that lose nothing check what is observed, and begin episodes with the seeds of `evaluate`.
        self.links = LossyLinks(env, joint=False)
        self.agents = list(env.possible_agents)
        self._spaces = [env.action_space(agent) for agent in self.agents]
        known = getattr(env.unwrapped, "max_cycles", None) if horizon is None else horizon
        #: Steps of the longest episode, and whether that is known.
        self.is_bounded = known is not None
        self.horizon = int(known) if known is not None else _MAX_STEPS
        self.actions = [_described(agent, space) for agent, space in zip(self.agents, self._spaces)]
        #: The words of an action.
        self.width = max(len(actions["box"]["low"]) if "box" in actions else 1 for actions in self.actions)

    def description(self) -> dict[str, Any]:
        """What the environment is."""
        said = values.of(self.links.env) or {}
        agents = [
            {
                "name": name,
                "observation": values.complete(agent, {agent: said.get(agent, [None] * length)}, length),
                "actions": actions,
            }
            for agent, (name, length), actions in zip(self.agents, self.links.observers, self.actions)
        ]
        dt = values.step(self.links.env)
        return {"id": self.links.name, "agents": agents, "episode_steps": self.horizon, "dt": dt}

    def reset(self, seed: int, episode: int) -> None:
        """Begins an episode."""
        self.links.reset(seed=seed, options={"episode": episode})
        self._steps = 0
        if not self.links.agents:
            raise Error("an episode is over before its first step")

    def step(self, words: Any) -> tuple[list[float], int]:
        """One step, with the words of each agent's action: what each earns, and whether the episode is over."""
        actions = {agent: _action(space, row) for agent, space, row in zip(self.agents, self._spaces, words)}
        _, rewards, terminations, truncations, _ = self.links.step(actions)
        self._steps += 1
        paid = [self._reward(agent, rewards) for agent in self.agents]
        left = [agent for agent in self.agents if agent not in self.links.agents]
        if left and len(left) < len(self.agents):
            raise AgentError(left[0], "has left; all agents must stay until the episode ends")
        if left:
            return paid, _TERMINATED if all(terminations.get(agent) for agent in self.agents) else _TRUNCATED
        if self._steps >= self.horizon and not self.is_bounded:
            raise Error(f"an episode is still going on after {_MAX_STEPS} steps; end it, or give --horizon")
        return paid, _OPEN

    @staticmethod
    def _reward(agent: Any, rewards: dict[Any, Any]) -> float:
        reward = float(rewards.get(agent, np.nan))
        if not np.isfinite(reward):
            raise AgentError(agent, f"gets the reward {rewards.get(agent)}, which is no number")
        return reward


def serve(make: Callable[[], Any], told: str, horizon: int | None = None) -> None:
    """Hosts the environments that `make` makes until the supervisor that said `told` sends this process away."""
    host = Host(told)
    worlds = [World(make(), horizon) for _ in range(host.worlds)]
    host.describe(json.dumps(worlds[0].description()))
    observed = np.zeros((len(worlds), *worlds[0].links.sent.shape), np.float32)
    while (request := host.next()) is not None:
        if len(request) == 3:
            number, seed, episode = request
            worlds[number].reset(seed, episode)
            observed[number] = worlds[number].links.sent
            rewards, ends, shown = np.zeros((1, len(worlds[0].agents))), np.zeros(1, np.uint8), observed[number, None]
        else:
            playing = np.frombuffer(request[0], np.uint8)
            words = np.frombuffer(request[1], np.uint32).reshape(-1, len(playing), worlds[0].width)
            rewards, ends = np.zeros((len(playing), len(worlds[0].agents))), np.zeros(len(playing), np.uint8)
            for number in np.flatnonzero(playing):
                rewards[number], ends[number] = worlds[number].step(words[:, number])
                observed[number] = worlds[number].links.sent
            shown = observed[: len(playing)]
        host.answer(rewards, ends, np.ascontiguousarray(shown.swapaxes(0, 1)))


def _described(agent: Any, space: spaces.Space[Any]) -> dict[str, Any]:
    """What an agent can do."""
    if isinstance(space, spaces.Discrete) and space.start == 0:
        return {"discrete": int(space.n)}
    if isinstance(space, spaces.Box) and len(space.shape) == 1 and space.shape[0] and space.is_bounded():
        return {"box": {"low": space.low.astype(float).tolist(), "high": space.high.astype(float).tolist()}}
    raise AgentError(agent, f"acts by {space}, but a swarm takes Discrete from 0 on, or Box: a vector within bounds")


def _action(space: spaces.Space[Any], words: Any) -> Any:
    """The action that these words are."""
    if isinstance(space, spaces.Discrete):
        return int(words[0])
    assert space.shape is not None and space.dtype is not None
    return words[: space.shape[0]].view(np.float32).astype(space.dtype)


def _maker(name: str, settings: Sequence[str]) -> Callable[[], Any]:
    """The function of this name, with these settings."""
    module, _, function = name.partition(":")
    keywords = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.isidentifier():
            raise Error(f"expected arguments such as N=4, not {setting}")
        try:
            keywords[key] = ast.literal_eval(value)
        except (SyntaxError, ValueError):
            keywords[key] = value
    make = getattr(import_module(module), function or "parallel_env")
    return lambda: make(**keywords)


def main(arguments: Sequence[str]) -> None:
    """Hosts what the command line says. Its last two words are the supervisor's."""
    parser = argparse.ArgumentParser("python3 -m vamaro_swarm.serve", description="Host a PettingZoo ParallelEnv.")
    parser.add_argument("env", help="module with a function parallel_env, or module:function")
    parser.add_argument("settings", nargs="*", metavar="KEY=VALUE", help="arguments of that function")
    parser.add_argument("--horizon", type=int, help="steps of the longest episode [default: the environment's max_cycles]")
    if len(arguments) < 2 or arguments[-2] != "environment":
        parser.error("`vamaro-swarm spawn --env COMMAND` runs this command")
    options = parser.parse_args(arguments[:-2])
    try:
        serve(_maker(options.env, options.settings), arguments[-1], options.horizon)
    except Exception as error:
        if not isinstance(error, Error):
            traceback.print_exc()
        words = error if isinstance(error, (Error, ValueError)) else f"{type(error).__name__}: {error}"
        sys.exit(f"error: {options.env}: {words}")


if __name__ == "__main__":
    main(sys.argv[1:])
