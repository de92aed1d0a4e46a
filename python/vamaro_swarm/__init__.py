"""What does a trained team do when its radio fails?

Lossy links, imputers and paired statistics, for our tasks and any PettingZoo ParallelEnv. See docs/python.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from ._native import version as __version__

if TYPE_CHECKING:
    from .errors import AgentError as AgentError
    from .errors import Error as Error
    from .evaluation import Evaluation as Evaluation
    from .evaluation import evaluate as evaluate
    from .fitted import FittedImputer as FittedImputer
    from .fitting import fit_imputer as fit_imputer
    from .links import LossyLinks as LossyLinks
    from .policies import Team as Team
    from .policies import load_policy as load_policy
    from .tasks import TaskEnv as TaskEnv
    from .tasks import parallel_env as parallel_env
    from .training import train as train
    from .vector import VectorEnv as VectorEnv

# Agents are processes that import this package and do not need numpy, so each name is imported on first use.
_HOMES = {
    "AgentError": "errors",
    "Error": "errors",
    "Evaluation": "evaluation",
    "FittedImputer": "fitted",
    "LossyLinks": "links",
    "TaskEnv": "tasks",
    "Team": "policies",
    "VectorEnv": "vector",
    "evaluate": "evaluation",
    "fit_imputer": "fitting",
    "load_policy": "policies",
    "parallel_env": "tasks",
    "train": "training",
}

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return __all__
