"""Actors that turn joint estimates into logits: that of the swarm's policy by numpy, or any ONNX file by onnxruntime.

A policy in Python turns them into actions itself.
"""

import json
import os
import sys
from importlib import import_module

import numpy as np


class PolicyActor:
    """The actor of one agent in a policy file (docs/policy-file.md), in f64: a layer is x @ weight + bias."""

    def __init__(self, path, agent, agents):
        with open(path, "rb") as file:
            about = json.loads(file.read(int.from_bytes(file.read(8), "little")))
            values = file.read()
        kind = about.pop("__metadata__")
        if "actor_inputs" in kind:
            sys.exit(f"error: the actors of {path} do not just see joint estimates; only the swarm's own agents run these")
        shared = kind["sharing"] == "shared"
        prefix = "actors.shared." if shared else f"actors.{agent}."
        self.tensors = {
            name.removeprefix(prefix): read(values, tensor) for name, tensor in about.items() if name.startswith(prefix)
        }
        # A shared actor also gets the index of its agent, after the estimate.
        self.identity = np.eye(agents)[agent] if shared else None

    def begin(self, worlds, _episode):
        """Begins an episode in each of the worlds, the first of this number."""
        self.state = np.zeros((worlds, len(self.tensors["out.weight"])))

    def logits(self, estimates, _own):
        if self.identity is not None:
            estimates = np.hstack([estimates, np.tile(self.identity, (len(estimates), 1))])
        x = np.maximum(self._layer("fc1", estimates), 0)
        x = np.maximum(self._layer("fc2", x), 0) if "fc2.weight" in self.tensors else self._gru(x)
        return self._layer("out", x)

    def _layer(self, name, x):
        return x @ self.tensors[f"{name}.weight"] + self.tensors[f"{name}.bias"]

    def _gru(self, x):
        gates = [x @ self.tensors["gru.weight_ih"] + self.tensors["gru.bias_ih"]]
        gates += [self.state @ self.tensors["gru.weight_hh"] + self.tensors["gru.bias_hh"]]
        (r, z, n), (r_h, z_h, n_h) = (np.split(gate, 3, axis=1) for gate in gates)
        r, z = sigmoid(r + r_h), sigmoid(z + z_h)
        self.state = (1 - z) * np.tanh(n + r * n_h) + z * self.state
        return self.state


class OnnxActor:
    """An ONNX file, with a row for each world. The first input is the joint estimates, or the own observations if it has
    their width; the first output is the logits. The others are states, zero at first: output n becomes input n."""

    def __init__(self, path):
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        self.inputs = self.session.get_inputs()

    def begin(self, worlds, _episode):
        self.states = [np.zeros([worlds, *state.shape[1:]], np.float32) for state in self.inputs[1:]]

    def logits(self, estimates, own):
        seen = own if self.inputs[0].shape[1] == own.shape[1] else estimates
        names = [tensor.name for tensor in self.inputs]
        logits, *self.states = self.session.run(None, dict(zip(names, [seen, *self.states])))
        return logits


class CallableActor:
    """A policy in Python, as `vamaro_swarm.evaluate` takes it: `policy(agent, estimate)` is an action, and if there is
    `policy.begin(seed, episode)`, it is called first. Parts of estimates are as long as their agents' observations."""

    def __init__(self, name, settings, agent):
        spec = settings["spec"]
        if settings["worlds"] > 1:
            sys.exit("error: a policy in Python plays one world at a time; use --worlds 1")
        sys.path.insert(0, os.getcwd())
        module, _, function = name.partition(":")
        self.policy = getattr(import_module(module), function or "policy")
        self.seed, self.name = settings["seed"], spec["agents"][agent]["name"]
        self.values = "box" in spec["agents"][agent]["actions"]
        parts = [(at * spec["unique"], len(one["observation"])) for at, one in enumerate(spec["agents"])]
        columns = [np.arange(begin, begin + length) for begin, length in parts]
        common = len(spec["agents"]) * spec["unique"] + np.arange(len(spec["common"]))
        self.columns = np.concatenate([*columns, common])

    def begin(self, _worlds, episode):
        begin = getattr(self.policy, "begin", None)
        if begin is not None:
            begin(self.seed, episode)

    def act(self, estimates):
        """The action, `[1, values]`."""
        action = self.policy(self.name, estimates[0, self.columns])
        return np.array(action, np.float32 if self.values else np.int64).reshape(1, -1)


def choose(logits, draw, greedy):
    """The most probable action, or the one whose share of [0, 1) contains the draw."""
    if greedy:
        return int(np.argmax(logits))
    weights = np.exp(logits.astype(np.float64) - float(logits.max())).tolist()
    total = 0.0
    for weight in weights:  # sum() corrects its rounding from Python 3.12 on, and the swarm's own agents do not
        total += weight
    left = draw * total
    for action, weight in enumerate(weights):
        left -= weight
        if left < 0:
            return action
    return int(np.argmax(logits))


def read(values, tensor):
    kind = {"F32": np.float32, "F16": np.float16}[tensor["dtype"]]
    stored = np.frombuffer(values[slice(*tensor["data_offsets"])], kind)
    return stored.reshape(tensor["shape"]).astype(np.float64)


def sigmoid(x):
    return 1 / (1 + np.exp(-x))
