"""An environment of two agents that observe constants, by docs/protocol.md alone: `spawn --env 'python3 THIS'`.

An episode has three steps. Agent i observes i and the number of its world, and earns i + 1 in each step.
"""

import ctypes
import json
import os
import signal
import sys
from pathlib import Path

import iceoryx2 as iox2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "agents/python"))
from wire import PROTOCOL, SHUTDOWN, Header, Port  # noqa: E402

DESCRIBE, RESET, STEP, OUTCOME = 7, 8, 9, 10
AGENTS, VALUES, STEPS = 2, 2, 3


class Line(Port):
    """The environment's end of the line: services are opened, and messages read and sent, as an agent does it."""

    def __init__(self):
        self.told = told = json.loads(sys.argv[-1])
        assert sys.argv[-2] == "environment" and told["wire"]["protocol"] == PROTOCOL
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: end with the supervisor
        config = iox2.config.default()
        config.global_cfg.root_path = iox2.Path.new(told["wire"]["root"])
        config.global_cfg.prefix = iox2.FileName.new(told["wire"]["prefix"])
        iox2.set_log_level(iox2.LogLevel.Fatal)
        builder = iox2.NodeBuilder.new().config(config).signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        self.node = builder.create(iox2.ServiceType.Ipc)
        self._requests = self._words("to-environment").subscriber_builder().buffer_size(2).create()
        self._woken = self._event("wake-environment").listener_builder().create()
        self._wake = self._event("wake-supervisor").notifier_builder().create()

    def open_answers(self, words):
        answers = self._words("from-environment").publisher_builder().initial_max_slice_len(words)
        self._answers = answers.max_loaned_samples(1).override_sample_preallocation(4).create()

    def next(self):
        while os.getppid() == self.told["supervisor"]:
            if sample := self._requests.receive():
                return self._read(sample)
            self._woken.timed_wait(iox2.Duration.from_secs_f64(0.1))
        sys.exit("error: the supervisor is gone")

    def answer(self, request, kind, words):
        header = Header.from_buffer_copy(request)
        header.protocol, header.kind, header.length = PROTOCOL, kind, len(words)
        header.swarm = int(self.told["tag"], 16)
        sample = self._answers.loan_slice_uninit(len(words))
        ctypes.memmove(sample.user_header_ptr, ctypes.byref(header), ctypes.sizeof(header))
        ctypes.memmove(sample.payload_ptr, words.ctypes.data, 4 * len(words))
        sample.assume_init().send()
        self._wake.notify()


def main():
    line = Line()
    worlds = line.told["worlds"]
    value = {"unit": "1", "about": "message", "axis": None, "rate": None}
    agents = [
        {"name": name, "observation": [value] * VALUES, "actions": {"discrete": 3}} for name in ("left", "right")
    ]
    text = json.dumps({"id": "constant", "episode_steps": 10, "dt": None, "agents": agents}).encode()
    described = np.frombuffer(text + b" " * (-len(text) % 4), np.uint32)
    line.open_answers(max(len(described), worlds * (2 * AGENTS + 1 + AGENTS * VALUES)))
    line.answer(Header(), DESCRIBE, described)
    steps = np.zeros(worlds, int)
    while True:
        request, words = line.next()
        if request.kind == SHUTDOWN:
            return
        if request.kind == RESET:
            steps[words[0]] = 0
            here, rewards, ends = words[:1], np.zeros((1, AGENTS)), np.zeros(1, np.uint32)
        else:
            assert request.kind == STEP and len(words) == request.worlds * (1 + AGENTS)
            here = np.arange(request.worlds)
            steps[here] += words[: request.worlds]
            rewards, ends = np.tile(np.arange(1.0, AGENTS + 1), (len(here), 1)), (steps[here] >= STEPS).astype(np.uint32)
        seen = np.array([[(agent, world) for world in here] for agent in range(AGENTS)], np.float32)
        line.answer(request, OUTCOME, np.concatenate([part.view(np.uint32).ravel() for part in (rewards, ends, seen)]))


if __name__ == "__main__":
    main()
