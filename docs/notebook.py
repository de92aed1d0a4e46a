# %% [markdown]
# # A team of your own, over links that fail
#
# A team is trained with a small PPO on mpe2's `simple_speaker_listener_v4`, frozen, and played over lossy links. Then an imputer is
# fitted to it, and all imputers are compared. Run it as a script (`python docs/notebook.py`, a quarter of an hour on a free core),
# or cell by cell in an editor that knows `# %%`. A number behind it is the seed of everything, 0 by default. With `--short` it
# trains and plays just enough to see that all works; the numbers then say nothing.

# %%
import sys
from pathlib import Path

import numpy as np
from mpe2 import simple_speaker_listener_v4
from vamaro_swarm import LossyLinks, evaluate, fit_imputer

SHORT = "--short" in sys.argv
SEED = next((int(word) for word in sys.argv[1:] if word.isdigit()), 0)
OUT = Path("notebook", "short" if SHORT else f"seed-{SEED}")  # what is written goes here
OUT.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## The task
#
# A listener moves among three landmarks and has to reach one of them. Which one only the speaker knows, who cannot move: it is
# in the speaker's observation, as a colour. So their observations differ, and the listener cannot do without the speaker's.

# %%
make = simple_speaker_listener_v4.parallel_env
env = make()
AGENTS = env.possible_agents
SIZES = [env.observation_space(agent).shape[0] for agent in AGENTS]
CHOICES = [int(env.action_space(agent).n) for agent in AGENTS]
JOINT = sum(SIZES)

# %% [markdown]
# ## Networks
#
# Two hidden layers of tanh. `forward` keeps what `backward` needs.


# %%
class Network:
    def __init__(self, rng, inputs, outputs, hidden=64, last=0.01):
        sizes = [(inputs, hidden, 1.0), (hidden, hidden, 1.0), (hidden, outputs, last)]
        self.weights = [(rng.normal(0, scale / np.sqrt(n), (n, m)), np.zeros(m)) for n, m, scale in sizes]
        self.moments = [[np.zeros_like(value) for value in pair for _ in "mv"] for pair in self.weights]
        self.updates = 0

    def forward(self, x):
        self.layers = [x]
        for number, (weight, bias) in enumerate(self.weights):
            x = x @ weight + bias
            x = x if number == 2 else np.tanh(x)
            self.layers.append(x)
        return x

    def backward(self, slope, rate):
        """One step of Adam, given the slope of the loss in the outputs of the last `forward`."""
        slopes = []
        for number in (2, 1, 0):
            slopes.insert(0, (self.layers[number].T @ slope, slope.sum(0)))
            slope = slope @ self.weights[number][0].T * (1 - self.layers[number] ** 2)
        norm = np.sqrt(sum(float((value**2).sum()) for pair in slopes for value in pair))
        self.updates += 1
        for pair, grads, moments in zip(self.weights, slopes, self.moments):
            for value, grad, m, v in zip(pair, grads, moments[::2], moments[1::2]):
                grad = grad * min(1.0, 0.5 / (norm + 1e-9))
                m += 0.1 * (grad - m)
                v += 0.001 * (grad**2 - v)
                m_hat, v_hat = m / (1 - 0.9**self.updates), v / (1 - 0.999**self.updates)
                value -= rate * m_hat / (np.sqrt(v_hat) + 1e-8)


def log_softmax(logits):
    shifted = logits - logits.max(-1, keepdims=True)
    return shifted - np.log(np.exp(shifted).sum(-1, keepdims=True))


# %% [markdown]
# ## PPO
#
# Everything is delivered while the team learns, so an actor sees both observations, one behind the other: what `LossyLinks`
# gives it at p = 1. Both are paid what the team earns. The critic sees the same.


# %%
def play(rng, envs, actors):
    """One episode in each environment: observations `[steps, envs, joint]`, actions `[agents, steps, envs]`, team rewards."""
    seen = [env.reset(seed=int(rng.integers(2**31)))[0] for env in envs]
    observed, acted, paid = [], [[] for _ in AGENTS], []
    while envs[0].agents:
        observed.append(np.array([np.concatenate([one[agent] for agent in AGENTS]) for one in seen]))
        for actor, actions in zip(actors, acted):
            logits = actor.forward(observed[-1])
            actions.append((logits + rng.gumbel(size=logits.shape)).argmax(-1))  # a sample of their softmax
        steps = [
            env.step({agent: int(actions[-1][number]) for agent, actions in zip(AGENTS, acted)})
            for number, env in enumerate(envs)
        ]
        seen = [step[0] for step in steps]
        paid.append([sum(step[1].values()) for step in steps])
    return np.array(observed), np.array(acted), np.array(paid)


def learn(updates, seed, envs=32, epochs=8, rate=1e-3, discount=0.95, smooth=0.95, clip=0.2, entropy=0.01):
    rng = np.random.default_rng(seed)
    worlds = [make() for _ in range(envs)]
    actors = [Network(rng, JOINT, choices) for choices in CHOICES]
    critic = Network(rng, JOINT, 1, last=1.0)
    for update in range(updates):
        observed, acted, paid = play(rng, worlds, actors)
        values = critic.forward(observed)[..., 0]
        ahead = np.vstack([values[1:], np.zeros(envs)])  # the time limit is taken for an end
        errors, advantage = paid / 10 + discount * ahead - values, np.zeros_like(values)
        for step in reversed(range(len(errors))):
            following = advantage[step + 1] if step + 1 < len(errors) else 0
            advantage[step] = errors[step] + discount * smooth * following
        inputs, targets = observed.reshape(-1, JOINT), (advantage + values).ravel()
        advantage = ((advantage - advantage.mean()) / advantage.std()).ravel()
        before = [
            np.take_along_axis(log_softmax(actor.forward(inputs)), actions.reshape(-1, 1), 1)[:, 0]
            for actor, actions in zip(actors, acted)
        ]
        now = rate * (1 - update / updates)
        for _ in range(epochs):
            for rows in np.array_split(rng.permutation(len(inputs)), 4):
                for actor, actions, old in zip(actors, acted, before):
                    logs = log_softmax(actor.forward(inputs[rows]))
                    shares, chosen = np.exp(logs), actions.ravel()[rows]
                    taken = np.eye(logs.shape[1])[chosen]
                    ratio = np.exp((logs * taken).sum(1) - old[rows])
                    gain = advantage[rows]
                    inside = np.where(gain > 0, ratio < 1 + clip, ratio > 1 - clip)
                    slope = -(inside * ratio * gain)[:, None] * (taken - shares)
                    slope += entropy * shares * (logs - (shares * logs).sum(1, keepdims=True))
                    actor.backward(slope / len(rows), now)
                error = critic.forward(inputs[rows])[:, 0] - targets[rows]
                critic.backward(error[:, None] / len(rows), now)
        if update % 20 == 0 or update == updates - 1:
            print(f"update {update:4}: return {paid.sum(0).mean():.1f}", flush=True)
    return actors


# %%
actors = learn(2 if SHORT else 800, SEED)

# %% [markdown]
# ## The frozen team
#
# A policy is a callable: agent and joint estimate in, action out. Here it takes the most probable action.

# %%
team = dict(zip(AGENTS, actors))


def policy(agent, estimate):
    return int(team[agent].forward(estimate.astype(np.float64)).argmax())


links = LossyLinks(make(), p=0.2, imputer="hold")
observations, infos = links.reset(seed=1)
print({agent: (seen.shape, infos[agent]["ages"].tolist()) for agent, seen in observations.items()})

# %% [markdown]
# ## An imputer for it
#
# `fit_imputer` plays the team, and trains a predictor of what each agent will observe.

# %%
sizes = dict(steps=400, updates=20) if SHORT else dict(steps=50_000, updates=2_000)
fitted = fit_imputer(make, policy, seed=SEED, out=OUT / "imputer.safetensors", **sizes)

# %% [markdown]
# ## How robust is it?
#
# All imputers meet the same losses in the same episodes. Everything is delivered at the first step.

# %%
imputers = {"zero": "zero", "hold": "hold", "velocity": "velocity", "kalman": "kalman", "fitted": fitted}
played = dict(imputers=imputers, episodes=2 if SHORT else 200, seed=SEED)
result = evaluate(make, policy, **played)
print(result.table())
print(result.report(OUT / "report"))

# %% [markdown]
# The same if the first step is lossy, too: until the first message arrives, nobody knows where to go.

# %%
late = evaluate(make, policy, share_at_start=False, **played)
print(late.table())
