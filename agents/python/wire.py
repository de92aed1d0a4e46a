"""The wire of a swarm for an agent in Python: messages, services, and how to wait. See docs/protocol.md.

Needs iceoryx2 (0.10) and numpy. `Port` is an agent's place in a swarm; what the agent does with it is in hold.py.
"""

import ctypes
import json
import os
import signal
import sys
import time

import iceoryx2 as iox2
import numpy as np

PROTOCOL = 8
READY, SENSOR, OBSERVATION, DECISION, SHUTDOWN = 1, 2, 3, 4, 5
NOT_ARRIVED = 255
LARGEST = 1e9  # values of observations beyond this are invalid
OLDEST = 100  # ticks; what is older is not passed on


class Header(ctypes.Structure):
    """The header of every message."""

    _fields_ = [
        ("protocol", ctypes.c_uint32),
        ("kind", ctypes.c_uint32),
        ("swarm", ctypes.c_uint64),
        ("incarnation", ctypes.c_uint32),
        ("sender", ctypes.c_uint32),
        ("episode", ctypes.c_uint64),
        ("tick", ctypes.c_uint64),
        ("step", ctypes.c_uint32),
        ("worlds", ctypes.c_uint32),
        ("length", ctypes.c_uint64),
        ("weights", ctypes.c_uint64),
        ("sent_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("absent", ctypes.c_uint64),
    ]

    @staticmethod
    def type_name():
        return "VamaroSwarmHeader"


class Sensor:
    """What an agent is told at a tick."""

    def __init__(self, header, words, layout):
        self.header = header
        worlds, action, agents = header.worlds, layout["action"], layout["agents"]
        ends = np.cumsum([worlds * action, words_of_ages(worlds, agents), 2 * worlds])
        actions, ages, draws, observations = np.split(words, ends)
        self.carried_out = actions.reshape(worlds, action)
        self.ages = ages.view(np.uint8)[: worlds * agents].reshape(worlds, agents)
        self.draws = np.frombuffer(draws.tobytes(), np.float64)
        self.observations = observations.view(np.float32).reshape(worlds, layout["observation"])


class Port:
    """An agent's side of the bus, as the supervisor's last word on the command line says."""

    def __init__(self):
        self.told = told = json.loads(sys.argv[-1])
        address, wire = told["address"], told["wire"]
        if wire["protocol"] != PROTOCOL:
            sys.exit(f"error: this agent speaks version {PROTOCOL} of the protocol, the swarm {wire['protocol']}")
        if address["weights"]:
            sys.exit("error: this agent does not learn; start it in a swarm whose policy is frozen")
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: end with the supervisor
        self.index, self.layout, self.swarm = told["agent"], wire["layout"], int(address["tag"], 16)
        self.spins = told["wait"] == "spin"
        self.patience = told["peers"]["secs"]
        self.own, self.decided = None, None  # the tick's sensor message; the tick of the last decision
        self.peers, self.started = {}, {}  # messages by sender and tick; how often each peer was started
        self.relay = self.layout["relay"]
        self.held, self.last = {}, None  # what to pass on, and when it was made; the header of the last tick
        config = iox2.config.default()
        config.global_cfg.root_path = iox2.Path.new(wire["root"])
        config.global_cfg.prefix = iox2.FileName.new(wire["prefix"])
        iox2.set_log_level(iox2.LogLevel.Fatal)
        self.node = (
            iox2.NodeBuilder.new().config(config).signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        ).create(iox2.ServiceType.Ipc)
        if told["incarnation"] > 0:
            self.node.try_cleanup_dead_nodes()  # the agent's predecessor still holds its ports
        self._sensor = self._words(f"sensor-{self.index}").subscriber_builder().buffer_size(2).create()
        observations, decisions = self._words("observations"), self._words("decisions")
        self._observations_in = observations.subscriber_builder().buffer_size(2).create()
        worlds = address["worlds"]
        self._observations_out = self._publisher(observations, self.observation_words(worlds))
        self._decisions_out = self._publisher(decisions, self.decision_words(worlds))
        self._wake = self._event("wake-supervisor").notifier_builder().create()
        self._woken = self._event("wake-agents").listener_builder().create()

    def observation_words(self, worlds):
        agents, length = self.layout["agents"], self.layout["observation"]
        return words_of_ages(worlds, agents) + worlds * agents * length if self.relay else worlds * length

    def decision_words(self, worlds):
        layout = self.layout
        each = layout["action"] + layout["joint"] + layout["logits"]
        return words_of_ages(worlds, layout["agents"]) + worlds * each + 4

    def report_ready(self):
        """Tells the supervisor that the agent is ready."""
        header = Header(worlds=0)
        self._send(self._decisions_out, header, READY, np.zeros(1, np.uint32))
        self.wake()

    def next_tick(self):
        """Waits for the next tick, and publishes the own observation. None if the agent must leave."""
        while True:
            sensed = self._sense()
            if sensed == "leave":
                return None
            if sensed:
                self._publish()
                return self.own
            self._sleep(0.1)

    def await_peers(self):
        """Waits for the peers' observations: in lockstep for all that are present, else until the deadline. False if the
        agent must leave."""
        end = time.monotonic() + self.patience
        while True:
            self._collect()
            header = self.own.header
            left = (header.deadline_ns - time.monotonic_ns()) / 1e9 if header.deadline_ns else end - time.monotonic()
            if left <= 0 or not header.deadline_ns and self._is_complete():
                return True
            # The supervisor may send again whom to wait for, or, in real time, the next tick.
            tick, sensed = header.tick, self._sense()
            if sensed == "leave":
                return False
            if sensed and self.own.header.tick != tick:
                self._publish()
            elif not sensed:
                self._sleep(min(left, 0.1), wakes=not header.deadline_ns)

    def delivered(self, world, origin):
        """What a peer observed that is new in a world, and how old it is; None if nothing is. To be called once a tick."""
        if not self.relay:
            return self._told(world, origin, origin)
        told = [self._told(world, sender, origin) for sender in range(self.layout["agents"])]
        newest = min((found for found in told if found), key=lambda found: found[1], default=None)
        if newest is None or newest[1] >= self._age(world, origin):
            return None
        self.held[world, origin] = newest[0], self.own.header.tick - newest[1]
        return newest

    def _told(self, world, sender, origin):
        """What the message that arrives from a sender tells of an agent, and how old that is; None if nothing."""
        age, now = int(self.own.ages[world, sender]), self.own.header
        message = self.peers.get((sender, now.tick - age)) if age != NOT_ARRIVED else None
        if message is None or now.deadline_ns and message[0].sent_ns > now.deadline_ns:
            return None
        _, ages, observations = message
        if world >= len(observations):
            return None
        if not self.relay:
            return observations[world], age
        then = int(ages[world, origin])
        return (observations[world, origin], age + then) if age + then <= OLDEST else None

    def _age(self, world, origin):
        """How old what is held of an agent is."""
        made = self.held[world, origin][1] if (world, origin) in self.held else -OLDEST
        age = self.own.header.tick - made
        return age if age <= OLDEST else NOT_ARRIVED

    def decide(self, actions, ages, estimates, logits, received_ns, fused_ns):
        """Publishes a decision, each part `[worlds, ..]`. Actions are numbers, or rows of f32 values."""
        words = actions.view(np.uint32) if actions.dtype == np.float32 else actions.astype(np.uint32)
        acts = np.zeros((len(words), self.layout["action"]), np.uint32)
        acts[:, : words.size // len(words)] = words.reshape(len(words), -1)
        padded = np.zeros(4 * words_of_ages(*ages.shape), np.uint8)
        padded[: ages.size] = ages.ravel()
        parts = [acts, padded.view(np.uint32), estimates.view(np.uint32)]
        if self.layout["logits"]:
            parts.append(np.ascontiguousarray(logits).view(np.uint32))
        parts.append(np.array([received_ns, fused_ns], np.uint64).view(np.uint32))
        words = np.concatenate([part.ravel() for part in parts])
        self._send(self._decisions_out, self.own.header, DECISION, words)
        if not self.own.header.deadline_ns:
            self.wake()
        self.decided = self.own.header.tick

    def _publish(self):
        words = self._relayed() if self.relay else self.own.observations.view(np.uint32).ravel()
        self._send(self._observations_out, self.own.header, OBSERVATION, words)
        if not self.own.header.deadline_ns:
            self.wake()

    def _relayed(self):
        """What is held of all agents, as a message."""
        now, last = self.own.header, self.last
        if last is None or now.step == 0 or now.episode != last.episode or now.tick > last.tick + 1:
            self.held = {}
        self.last = now
        agents, length = self.layout["agents"], self.layout["observation"]
        ages = np.zeros(4 * words_of_ages(now.worlds, agents), np.uint8)
        observations = np.zeros((now.worlds, agents, length), np.float32)
        for world, origin in np.ndindex(now.worlds, agents):
            age = 0 if origin == self.index else self._age(world, origin)
            ages[world * agents + origin] = age
            if origin == self.index:
                observations[world, origin] = self.own.observations[world]
            elif age != NOT_ARRIVED:
                observations[world, origin] = self.held[world, origin][0]
        return np.concatenate([ages.view(np.uint32), observations.view(np.uint32).ravel()])

    def _sense(self):
        """The newest message of the supervisor: a tick, "leave", or None if there is none."""
        sensed = None
        while sample := self._sensor.receive():
            header, words = self._read(sample)
            ours = header.protocol == PROTOCOL and header.swarm == self.swarm and header.length == len(words)
            if ours and header.kind == SHUTDOWN:
                return "leave"
            each = self.layout["action"] + 2 + self.layout["observation"]
            expected = words_of_ages(header.worlds, self.layout["agents"]) + header.worlds * each
            if not ours or header.kind != SENSOR or len(words) != expected:
                sys.exit(f"error: agent-{self.index} got a message it cannot read")
            if header.incarnation and header.tick == self.decided:
                continue  # sent again for a tick already decided
            self.own, sensed = Sensor(header, words, self.layout), "tick"
        return sensed

    def _collect(self):
        agents, length = self.layout["agents"], self.layout["observation"]
        while sample := self._observations_in.receive():
            header, words = self._read(sample)
            fits = header.protocol == PROTOCOL and header.kind == OBSERVATION and header.swarm == self.swarm
            fits = fits and header.sender < agents and len(words) == self.observation_words(header.worlds)
            if not fits or header.incarnation < self.started.get(header.sender, 0):
                continue
            ages, values = np.split(words, [words_of_ages(header.worlds, agents) if self.relay else 0])
            ages, values = ages.view(np.uint8), values.view(np.float32)
            if self.relay:
                ages = ages[: header.worlds * agents].reshape(header.worlds, agents)
                own = np.arange(agents) == header.sender
                fits = np.array_equal(ages == 0, np.broadcast_to(own, ages.shape))
            if fits and np.all(np.abs(values) <= LARGEST):
                self.started[header.sender] = header.incarnation
                # The first message of a tick counts.
                message = header, ages, values.reshape(header.worlds, *[agents] * self.relay, length)
                self.peers.setdefault((header.sender, header.tick), message)
        oldest = self.own.header.tick - self.told["address"]["longest_delay"]
        self.peers = {key: kept for key, kept in self.peers.items() if key[1] >= oldest}

    def _is_complete(self):
        left_out, tick = self.own.header.absent | 1 << self.index, self.own.header.tick
        senders = range(self.layout["agents"])
        return all(left_out >> sender & 1 or (sender, tick) in self.peers for sender in senders)

    def wake(self):
        if not self.spins:
            self._wake.notify()

    def _sleep(self, longest, wakes=True):
        if os.getppid() != self.told["supervisor"]:
            sys.exit("error: the supervisor is gone, or the command did not `exec` this agent")
        if self.spins:
            time.sleep(0)
        elif wakes:
            self._woken.timed_wait(iox2.Duration.from_secs_f64(longest))
        else:
            time.sleep(longest)

    def _send(self, publisher, answers, kind, words):
        sample = publisher.loan_slice_uninit(len(words))
        header = Header.from_buffer_copy(answers)
        header.protocol, header.kind, header.swarm = PROTOCOL, kind, self.swarm
        header.incarnation, header.sender, header.length = self.told["incarnation"], self.index, len(words)
        header.sent_ns = time.monotonic_ns()
        ctypes.memmove(sample.user_header_ptr, ctypes.byref(header), ctypes.sizeof(header))
        ctypes.memmove(sample.payload_ptr, words.ctypes.data, 4 * len(words))
        sample.assume_init().send()

    @staticmethod
    def _read(sample):
        """A copy of a message. Its words are counted by iceoryx2's own header: `len()` of a slice counts bytes in 0.10.0."""
        header = Header.from_buffer_copy(ctypes.string_at(sample.user_header_ptr, ctypes.sizeof(Header)))
        words = ctypes.string_at(sample.payload_ptr, 4 * sample.header.number_of_elements)
        return header, np.frombuffer(words, np.uint32)

    def _words(self, name):
        service = self.node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(iox2.Slice[ctypes.c_uint32])
        return service.user_header(Header).open()

    def _event(self, name):
        return self.node.service_builder(iox2.ServiceName.new(name)).event().open()

    def _publisher(self, service, words):
        builder = service.publisher_builder().initial_max_slice_len(words).max_loaned_samples(1)
        return builder.override_sample_preallocation(self.told["wire"]["samples"]).create()


def words_of_ages(worlds, agents):
    return -(-worlds * agents // 4)
