"""What an agent believes of others: the last that it was told, or what a fitted imputer makes of it."""

import sys

import numpy as np

from wire import NOT_ARRIVED


class Hold:
    """The last value received, or zero."""

    def __init__(self, told):
        imputer = told["settings"]["imputer"]
        if imputer != "hold":
            sys.exit(f"error: this agent imputes by `hold`, not by `{imputer}`; use --imputer hold")
        self.agents, self.unique = told["wire"]["layout"]["agents"], told["settings"]["spec"]["unique"]
        self.me = told["agent"]

    def begin(self, worlds):
        """Begins an episode in each of the worlds."""
        self.carried = np.zeros((worlds, self.agents, self.unique), np.float32)

    def fuse(self, ages, observations):
        """The joint estimates: each agent's own values, then those that are the same for all."""
        arrived = ages != NOT_ARRIVED
        self.carried[arrived] = observations[arrived, : self.unique]
        common = observations[:, self.me, self.unique :]
        return np.hstack([self.carried.reshape(len(ages), -1), common])

    def predict(self):
        """What was received stays as it is."""


def fitted(path, told):
    """The imputer that `vamaro_swarm.fit_imputer` wrote to a file."""
    from vamaro_swarm import Error, FittedImputer

    try:
        return FittedImputer(path).for_agent(told)
    except (Error, ValueError) as error:
        sys.exit(f"error: {error}")
