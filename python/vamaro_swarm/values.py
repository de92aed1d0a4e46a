"""What the values of an observation mean, as far as an environment says so.

`env.metadata["values"]` has a list for each agent, with a dict for each value, or None if nothing is known:

    {"unit": "m/s", "about": 0, "axis": "x"}                   the velocity of agent 0
    {"unit": "m", "about": 0, "axis": "x", "rate": (0, 1)}     its position, whose rate of change is value 0
    {"unit": "m", "about": 0, "axis": "x", "rate": (0, -1)}    a landmark relative to agent 0, which moves against it

`env.metadata["dt"]` is how long a step is, in seconds.
"""

from typing import Any

from .errors import AgentError

#: What is said of one value.
Said = dict[str, Any] | None


def of(env: Any) -> dict[Any, list[Said]] | None:
    """The metadata of an environment for all agents; for mpe2's, which have none, what is known by their names."""
    said: dict[Any, list[Said]] | None = env.metadata.get("values")
    if said is not None:
        return said
    known = _MPE.get(str(env.metadata.get("name")))
    if known is None or not type(env.unwrapped).__module__.startswith(("mpe2.", "pettingzoo.")):
        return None
    agents = list(env.possible_agents)
    lengths = [env.observation_space(agent).shape[0] for agent in agents]
    return {agent: known(number, len(agents), length) for number, (agent, length) in enumerate(zip(agents, lengths))}


def step(env: Any) -> float | None:
    """The length of a step in seconds, if known."""
    world = getattr(env.unwrapped, "world", None)
    dt = env.metadata.get("dt", getattr(world, "dt", None))
    return None if dt is None else float(dt)


def complete(agent: Any, said: dict[Any, list[Said]], length: int) -> list[dict[str, Any]]:
    """The metadata of an agent's values, with defaults filled in."""
    own = said.get(agent)
    if own is None or len(own) != length:
        found = "nothing" if own is None else f"{len(own)} values"
        raise AgentError(agent, f"metadata['values'] has {found} for it, but it sends {length}")
    return [_complete(value) for value in own]


def _complete(value: Said) -> dict[str, Any]:
    if value is None:
        return {"unit": "1", "about": "message", "axis": None, "rate": None}
    about = value.get("about", "message")
    rate = value.get("rate")
    return {
        "unit": value.get("unit", "1"),
        "about": {"agent": about} if isinstance(about, int) else about,
        "axis": value.get("axis"),
        "rate": None if rate is None else [int(rate[0]), float(rate[1])],
    }


def _velocity(about: int) -> list[Said]:
    return [{"unit": "m/s", "about": about, "axis": axis} for axis in "xy"]


def _moving(about: int, sign: int) -> list[Said]:
    """A place in front of which the agent's velocity stands."""
    return [{"unit": "m", "about": about, "axis": axis, "rate": (number, sign)} for number, axis in enumerate("xy")]


def _padded(said: list[Said], length: int) -> list[Said]:
    """The same with nothing said of what follows; nothing at all if there is less."""
    return said + [None] * (length - len(said)) if len(said) <= length else [None] * length


def _spread(agent: int, agents: int, length: int) -> list[Said]:
    # Velocity, place, as many landmarks as agents, the others, what they say.
    if length != 6 * agents:
        return [None] * length
    return _padded(_velocity(agent) + _moving(agent, 1) + _moving(agent, -1) * agents, length)


def _tag(agent: int, agents: int, length: int) -> list[Said]:
    # Velocity, place, landmarks, the others, and how fast those who flee are.
    return _padded(_velocity(agent) + _moving(agent, 1), length)


def _reference(agent: int, agents: int, length: int) -> list[Said]:
    # Velocity, three landmarks, a colour, what is said.
    return _padded(_velocity(agent) + _moving(agent, -1) * 3, length)


def _speaker_listener(agent: int, agents: int, length: int) -> list[Said]:
    # The speaker sees a colour; the listener its velocity, three landmarks, and what is said.
    return [None] * length if length == 3 else _reference(agent, agents, length)


_MPE = {
    "simple_spread_v3": _spread,
    "simple_tag_v3": _tag,
    "simple_reference_v3": _reference,
    "simple_speaker_listener_v4": _speaker_listener,
}
