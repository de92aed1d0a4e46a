"""Makes gru-dynamo.onnx: the actor of gru.th, by PyTorch's newer exporter. It says what gru.onnx says.

    python3 tests/data/onnx/make_newer.py

Made with PyTorch 2.6, the python3-torch of Debian 13, and onnxscript 0.7.
"""

import onnx
import torch

from make import HERE, HIDDEN, Gru

model = Gru(12 + 2, 5)
model.load_state_dict(torch.load(HERE / "gru.th"))
program = torch.onnx.export(
    model,
    (torch.zeros(14), torch.tensor([True]), torch.zeros(1, HIDDEN)),
    input_names=["observation", "is_init", "recurrent_state"],
    output_names=["logits", "next_recurrent_state"],
    dynamo=True,
)
exported = program.model_proto
for node in exported.graph.node:
    del node.metadata_props[:]  # where each comes from, which makes the file six times as long
onnx.save(exported, HERE / "gru-dynamo.onnx")
