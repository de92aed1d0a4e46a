"""A fitted imputer."""

from os import PathLike, fspath
from pathlib import Path


class FittedImputer:
    """An imputer that `fit_imputer` wrote to a file, for the environment it was fitted to."""

    def __init__(self, path: str | PathLike[str]) -> None:
        #: The policy file that holds its predictor.
        self.path = Path(fspath(path))
        if not self.path.is_file():
            raise ValueError(f"there is no file {self.path}; fit_imputer writes one")

    def __repr__(self) -> str:
        return f"FittedImputer({str(self.path)!r})"
