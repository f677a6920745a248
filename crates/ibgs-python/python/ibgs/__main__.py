"""The command line: `python -m ibgs train my-scene` is `ibgs train my-scene`."""

import sys

from . import Error, run


def main() -> int:
    """Runs the command that the arguments describe; the exit code."""
    try:
        run(sys.argv[1:])
    except Error as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as stopped:
        print(stopped, file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
