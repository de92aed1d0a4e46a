"""An agent in Python that plays beside those of vamaro-swarm. It imputes like `hold`: by the last value received.

    vamaro-swarm spawn --agents 4 --p 0.2 --imputer hold --agent '2=python3 agents/python/hold.py'

It acts by the swarm's own policy, or by what is given as argument: an ONNX file, or a policy in Python, `module:name`.
"""

import sys
import time

import numpy as np

from actor import CallableActor, OnnxActor, PolicyActor, choose
from wire import NOT_ARRIVED, Port


def main():
    port = Port()
    settings, me = port.told["settings"], port.index
    agents, unique = len(settings["spec"]["agents"]), settings["spec"]["unique"]
    available = settings["spec"]["agents"][me]["actions"].get("discrete")
    if settings["imputer"] != "hold":
        sys.exit(f"error: this agent imputes by `hold`, not by `{settings['imputer']}`; use --imputer hold")
    actor = actor_of(sys.argv[1:-2], settings, me)
    episode, carried = None, None

    port.report_ready()
    while sensor := port.next_tick():
        if not port.await_peers():
            return
        received_ns = time.monotonic_ns()
        sensor = port.own  # in real time, a newer one may have come
        worlds = sensor.header.worlds
        if sensor.header.step == 0 or sensor.header.episode != episode:
            episode, carried = sensor.header.episode, np.zeros((worlds, agents, unique), np.float32)
            actor.begin(worlds, episode)

        # The joint estimate: each agent's own values, then those that are the same for all.
        ages = np.full((worlds, agents), NOT_ARRIVED, np.uint8)
        for world in range(worlds):
            for sender in range(agents):
                heard = (sensor.observations[world], 0) if sender == me else port.delivered(world, sender)
                if heard:
                    observation, ages[world, sender] = heard
                    carried[world, sender] = observation[:unique]
        estimates = np.hstack([carried.reshape(worlds, -1), sensor.observations[:, unique:]])
        fused_ns = time.monotonic_ns()

        if isinstance(actor, CallableActor):
            actions, logits = actor.act(estimates), np.zeros((worlds, port.layout["logits"]), np.float32)
        else:
            logits = np.ascontiguousarray(actor.logits(estimates, sensor.observations), np.float32)
            chosen = zip(logits[:, :available], sensor.draws)
            actions = np.array([choose(row, draw, settings["greedy"]) for row, draw in chosen])
        port.decide(actions, ages, estimates, logits, received_ns, fused_ns)


def actor_of(words, settings, me):
    """What an agent acts by."""
    if words and not words[0].endswith(".onnx"):
        return CallableActor(words[0], settings, me)
    if "discrete" not in settings["spec"]["agents"][me]["actions"]:
        sys.exit("error: this agent acts by values; give it a policy in Python, such as my_team:policy")
    if words:
        return OnnxActor(words[0])
    if settings["policy"] == "nobody":
        sys.exit("error: the swarm has no policy for this agent; give it an ONNX file, or a policy such as my_team:policy")
    return PolicyActor(settings["policy"]["copy"], me, len(settings["spec"]["agents"]))


if __name__ == "__main__":
    main()
