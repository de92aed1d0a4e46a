"""The program `vamaro-swarm`."""

import signal
import sys

from . import _native


def main() -> None:
    """Runs the command line. Agents are started as `python -m vamaro_swarm agent ..`."""
    # The program has its own handlers. With Python's, the next line of Python would raise.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.main(sys.argv[1:], [sys.executable, "-P", "-m", "vamaro_swarm"]))


if __name__ == "__main__":
    main()
