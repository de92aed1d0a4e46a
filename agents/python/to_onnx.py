"""Writes the actor of one agent of a policy file as ONNX, for hold.py and other programs.

    python3 agents/python/to_onnx.py agents/pretrained/hear-see/seed-0.safetensors 1 actor.onnx

Needs onnx and numpy. The input `estimates` is [worlds, joint], the output `logits` [worlds, actions]; a recurrent actor has the
input `state` and the output `next_state`, too, [worlds, hidden]. The file must have an actor for each agent.
"""

import sys

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from actor import PolicyActor


def main(policy, agent, out):
    actor = PolicyActor(policy, int(agent), None)
    tensors = {name: tensor.astype(np.float32) for name, tensor in actor.tensors.items()}
    joint, hidden = tensors["fc1.weight"].shape
    nodes, inputs, outputs = [], [("estimates", joint)], [("logits", tensors["out.weight"].shape[1])]

    def layer(name, x, y):
        nodes.append(helper.make_node("Gemm", [x, f"{name}.weight", f"{name}.bias"], [y]))

    layer("fc1", "estimates", "x1")
    nodes.append(helper.make_node("Relu", ["x1"], ["h1"]))
    if "fc2.weight" in tensors:
        layer("fc2", "h1", "x2")
        nodes.append(helper.make_node("Relu", ["x2"], ["h2"]))
    else:
        inputs.append(("state", hidden))
        outputs.append(("next_state", hidden))
        tensors |= {"W": gates(tensors.pop("gru.weight_ih")), "R": gates(tensors.pop("gru.weight_hh"))}
        biases = [gates(tensors.pop(f"gru.bias_{of}")) for of in ("ih", "hh")]
        tensors |= {"B": np.hstack(biases), "axis": np.array([0])}
        nodes.append(helper.make_node("Unsqueeze", ["h1", "axis"], ["sequence"]))
        nodes.append(helper.make_node("Unsqueeze", ["state", "axis"], ["before"]))
        gru = ["sequence", "W", "R", "B", "", "before"]
        nodes.append(helper.make_node("GRU", gru, ["", "after"], hidden_size=hidden, linear_before_reset=1))
        nodes.append(helper.make_node("Squeeze", ["after", "axis"], ["next_state"]))
        nodes.append(helper.make_node("Identity", ["next_state"], ["h2"]))
    layer("out", "h2", "logits")

    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["worlds", n]) for name, n in inputs + outputs]
    weights = [numpy_helper.from_array(tensor, name) for name, tensor in tensors.items()]
    graph = helper.make_graph(nodes, "actor", values[: len(inputs)], values[len(inputs) :], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, out)


def gates(weight):
    """ONNX orders gates z, r, n and lays out [1, 3 hidden, inputs]; a policy file r, z, n and [inputs, 3 hidden]."""
    r, z, n = np.split(weight, 3, axis=-1)
    return np.ascontiguousarray(np.concatenate([z, r, n], axis=-1).T[None])


if __name__ == "__main__":
    main(*sys.argv[1:])
