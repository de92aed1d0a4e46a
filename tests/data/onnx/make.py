"""Makes small actors with PyTorch: as ONNX files, as state dicts that `import` reads, and what they say of some estimates.

    python3 tests/data/onnx/make.py

Made with PyTorch 1.13, the python3-torch of Debian 12. Names of inputs and outputs are those that TorchRL's
`export_onnx_policy` gives them: a state is called X, and next_X behind the step.
"""

import json
from pathlib import Path

import torch
from torch import nn

HERE, HIDDEN, STEPS = Path(__file__).parent, 8, 4


class Mlp(nn.Module):
    """As ours, with the names of the paper's code."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.fc1, self.rnn, self.fc2 = nn.Linear(inputs, HIDDEN), nn.Linear(HIDDEN, HIDDEN), nn.Linear(HIDDEN, outputs)

    def forward(self, x):
        return self.fc2(torch.relu(self.rnn(torch.relu(self.fc1(x)))))


class Gru(nn.Module):
    """As ours, one step without a batch."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.fc1, self.rnn, self.fc2 = nn.Linear(inputs, HIDDEN), nn.GRUCell(HIDDEN, HIDDEN), nn.Linear(HIDDEN, outputs)

    def forward(self, x, is_init, state):
        state = torch.where(is_init, torch.zeros_like(state), state)
        state = self.rnn(torch.relu(self.fc1(x)).unsqueeze(0), state)
        return self.fc2(state).squeeze(0), state


class Normed(nn.Module):
    """Other layers than ours."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(inputs, HIDDEN), nn.LayerNorm(HIDDEN), nn.Tanh(), nn.Linear(HIDDEN, outputs), nn.ELU())

    def forward(self, x):
        return self.layers(x)


class Lstm(nn.Module):
    """A layer over a sequence of one step; it learned what it remembers when an episode begins."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.lstm, self.out = nn.LSTM(inputs, HIDDEN), nn.Linear(HIDDEN, outputs)
        self.start = nn.Parameter(torch.randn(1, 1, HIDDEN))

    def forward(self, x, is_init, h, c):
        h = torch.where(is_init, self.start, h)
        x, (h, c) = self.lstm(x.view(1, 1, -1), (h, c))
        return torch.log_softmax(self.out(x.view(1, -1)), -1), h, c


class Gaussian(nn.Module):
    """Says means and log-stds."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.mean, self.log_std = nn.Linear(inputs, outputs), nn.Parameter(torch.full([outputs], -1.0))

    def forward(self, x):
        return self.mean(x), self.log_std + 0.0


def export(model, name, inputs, names, outputs, **options):
    torch.onnx.export(model, tuple(inputs), HERE / name, input_names=names, output_names=outputs, opset_version=17, **options)


@torch.no_grad()
def main():
    torch.manual_seed(0)
    expected = {}
    estimates = lambda n: torch.randn(STEPS, n)
    listed = lambda tensors: [[float(value) for value in tensor.flatten()] for tensor in tensors]

    # hear-see: one for each agent, in batches of any size.
    team = nn.ModuleList(Mlp(16, 5) for _ in range(2))
    for agent, model in enumerate(team):
        axes = {"observation": {0: "batch"}, "logits": {0: "batch"}}
        export(model, f"mlp-{agent}.onnx", [torch.zeros(1, 16)], ["observation"], ["logits"], dynamic_axes=axes)
    torch.save({f"agents.{key}": value for key, value in team.state_dict().items()}, HERE / "mlp.th")
    seen = estimates(16)
    expected["mlp"] = {"estimates": listed(seen), "logits": [listed(model(seen)) for model in team]}
    mean, std = torch.arange(16) / 16, torch.arange(1, 17) / 8
    expected["normalised"] = expected["mlp"] | {"logits": [listed(model((seen - mean) / std)) for model in team]}

    # spread-xy-2: all agents share one, which sees who it is, and is given no batch.
    model = Gru(12 + 2, 5)
    state, begins = torch.zeros(1, HIDDEN), torch.tensor([True])
    names = ["observation", "is_init", "recurrent_state"]
    export(model, "gru.onnx", [torch.zeros(14), begins, state], names, ["logits", "next_recurrent_state"])
    torch.save(model.state_dict(), HERE / "gru.th")
    seen = estimates(12)
    logits = []
    for identity in torch.eye(2):
        said, state = [], torch.ones(1, HIDDEN)
        for step, x in enumerate(seen):
            out, state = model(torch.cat([x, identity]), torch.tensor([step == 0]), state)
            said.append(out)
        logits.append(listed(said))
    expected["gru"] = {"estimates": listed(seen), "logits": logits}

    # speaker-listener: each on its own observation, which the speaker's padding is no part of.
    speaker, listener = Normed(3, 3), Lstm(11, 5)
    export(speaker, "own-0.onnx", [torch.zeros(1, 3)], ["obs"], ["scores"])
    state = [torch.zeros(1, 1, HIDDEN)] * 2
    names = ["obs", "is_init", "h", "c"]
    export(listener, "own-1.onnx", [torch.zeros(1, 11), begins, *state], names, ["scores", "h_out", "next_c"])
    seen = estimates(22)
    said, (h, c) = [], state
    for step, x in enumerate(seen):
        out, h, c = listener(x[None, 11:], torch.tensor([step == 0]), h, c)
        said.append(out)
    expected["own"] = {"estimates": listed(seen), "logits": [listed(speaker(seen[:, :3])), listed(said)]}

    # simple-spread-continuous-3: means and log-stds, of its own observation.
    model = Gaussian(18, 5)
    export(model, "gaussian.onnx", [torch.zeros(1, 18)], ["obs"], ["mean", "log_std"])

    (HERE / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")


if __name__ == "__main__":
    main()
