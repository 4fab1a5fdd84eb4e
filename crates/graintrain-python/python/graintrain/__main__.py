"""The command line: python -m graintrain."""

import signal
import sys

from graintrain import _graintrain


def main() -> None:
    """Carries out the words of the command line and ends the process with the exit code of `graintrain`."""
    # The command line answers Ctrl-C itself, by stopping in good order; Python's own handler would raise on top of that.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_graintrain.command_line(sys.argv[1:]))


if __name__ == "__main__":
    main()
