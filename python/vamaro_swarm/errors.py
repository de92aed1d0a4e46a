"""Exceptions, besides the ValueError of a request that makes no sense."""


class Error(Exception):
    """A valid request failed."""


class AgentError(Error):
    """An agent, its policy or its imputer did something invalid."""

    def __init__(self, agent: object, words: str) -> None:
        super().__init__(agent, words)
        #: Which agent.
        self.agent = agent

    def __str__(self) -> str:
        return f"{self.agent}: {self.args[1]}"
