"""What the values of an observation are, as far as an environment says it.

`env.metadata["values"]` has a list for each agent, with a dict for each value, or None where there is nothing to say:

    {"unit": "m/s", "about": 0, "axis": "x"}                   the velocity of agent 0
    {"unit": "m", "about": 0, "axis": "x", "rate": (0, 1)}     its place, which value 0 moves
    {"unit": "m", "about": 0, "axis": "x", "rate": (0, -1)}    a landmark seen from it, which comes nearer

`env.metadata["dt"]` is how long a step is, in seconds.
"""

from typing import Any

from .errors import AgentError

#: What is said of one value.
Said = dict[str, Any] | None


def of(env: Any) -> dict[Any, list[Said]] | None:
    """What an environment says of all agents, or what is known of it: of mpe2 by the name it has."""
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
    """How long a step is, s, if that is known."""
    world = getattr(env.unwrapped, "world", None)
    dt = env.metadata.get("dt", getattr(world, "dt", None))
    return None if dt is None else float(dt)


def complete(agent: Any, said: dict[Any, list[Said]], length: int) -> list[dict[str, Any]]:
    """What is said of an agent's values, with nothing left out."""
    own = said.get(agent)
    if own is None or len(own) != length:
        found = "nothing" if own is None else f"{len(own)} values"
        raise AgentError(agent, f"metadata['values'] says {found} of it, and it sends {length}")
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
