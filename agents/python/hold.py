"""An agent in Python that plays beside those of vamaro-swarm. It imputes like `hold`: by the last value received.

    vamaro-swarm spawn --agents 4 --p 0.2 --imputer hold --agent '2=python3 agents/python/hold.py'

It acts by the swarm's own policy, or by what is given as argument: an ONNX file, or a policy in Python, `module:name`. It
imputes by a fitted imputer instead if that is given, too: a file that ends with `.safetensors`.
"""

import sys
import time

import numpy as np

from actor import CallableActor, OnnxActor, PolicyActor, choose
from imputer import Hold, fitted
from wire import NOT_ARRIVED, Port


def main():
    port = Port()
    settings, me = port.told["settings"], port.index
    agents = len(settings["spec"]["agents"])
    available = settings["spec"]["agents"][me]["actions"].get("discrete")
    files = [word for word in sys.argv[1:-2] if word.endswith(".safetensors")]
    imputer = fitted(files[0], port.told) if files else Hold(port.told)
    actor = actor_of([word for word in sys.argv[1:-2] if word not in files], settings, me)
    episode = None

    port.report_ready()
    while sensor := port.next_tick():
        if not port.await_peers():
            return
        received_ns = time.monotonic_ns()
        sensor = port.own  # in real time, a newer one may have come
        worlds = sensor.header.worlds
        if sensor.header.step == 0 or sensor.header.episode != episode:
            episode = sensor.header.episode
            imputer.begin(worlds)
            actor.begin(worlds, episode)

        ages = np.full((worlds, agents), NOT_ARRIVED, np.uint8)
        observations = np.zeros((worlds, agents, port.layout["observation"]), np.float32)
        for world in range(worlds):
            for sender in range(agents):
                heard = (sensor.observations[world], 0) if sender == me else port.delivered(world, sender)
                if heard:
                    observations[world, sender], ages[world, sender] = heard
        estimates = imputer.fuse(ages, observations)
        fused_ns = time.monotonic_ns()

        if isinstance(actor, CallableActor):
            actions, logits = actor.act(estimates), np.zeros((worlds, port.layout["logits"]), np.float32)
        else:
            logits = np.ascontiguousarray(actor.logits(estimates, sensor.observations), np.float32)
            chosen = zip(logits[:, :available], sensor.draws)
            actions = np.array([choose(row, draw, settings["greedy"]) for row, draw in chosen])
        port.decide(actions, ages, estimates, logits, received_ns, fused_ns)
        imputer.predict()


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
