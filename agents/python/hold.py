"""An agent in Python that plays beside those of vamaro-swarm. It imputes like `hold`: by the last value received.

    vamaro-swarm spawn --agents 4 --p 0.2 --imputer hold --agent '2=python3 agents/python/hold.py'

It acts by the swarm's own policy, or by an ONNX file given as argument.
"""

import sys
import time

import numpy as np

from actor import OnnxActor, PolicyActor, choose
from wire import NOT_ARRIVED, Port


def main():
    port = Port()
    settings, me = port.told["settings"], port.index
    agents, unique = len(settings["spec"]["agents"]), settings["spec"]["unique"]
    available = settings["spec"]["agents"][me]["actions"]["discrete"]
    if settings["imputer"] != "hold":
        sys.exit(f"error: this agent imputes by `hold`, not by `{settings['imputer']}`; use --imputer hold")
    onnx = sys.argv[1:-2]
    actor = OnnxActor(onnx[0]) if onnx else PolicyActor(settings["policy"]["copy"], me, agents)
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
            actor.begin(worlds)

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

        logits = np.ascontiguousarray(actor.logits(estimates, sensor.observations), np.float32)
        chosen = zip(logits[:, :available], sensor.draws)
        actions = np.array([choose(row, draw, settings["greedy"]) for row, draw in chosen])
        port.decide(actions, ages, estimates, logits, received_ns, fused_ns)


if __name__ == "__main__":
    main()
