"""The command line: parse, call, print. Nothing heavy is imported before a command needs it.

Exit status: 0 done; 1 the run failed; 2 wrong usage or configuration; 130 stopped by the user.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

STOPPED = 130


def main() -> None:
    """Entry point of the program `schuler`."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Runs one command line and returns its exit status. No traceback reaches the user unless --debug is given."""
    from schuler.ground.errors import SchulerError

    arguments = list(arguments)
    debug = "--debug" in arguments
    arguments = [a for a in arguments if a != "--debug"]
    if arguments == ["--version"]:
        from schuler import __version__

        print(f"schuler {__version__}")
        return 0
    try:
        if not debug:
            import warnings

            warnings.simplefilter("ignore")
        from schuler.cli.app import build

        status = build()(args=arguments, prog_name="schuler", standalone_mode=False)
        sys.stdout.flush()
        if status == STOPPED:  # how newer parsers hand on a KeyboardInterrupt
            say("stopped; nothing was written")
        return int(status or 0)
    except SchulerError as error:
        if debug:
            raise
        say(str(error))
        return error.exit_status
    except BrokenPipeError:  # the reader of a pipe went away (schuler ... | head)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        say("stopped; nothing was written")
        return STOPPED
    except Exception as error:
        if type(error).__name__ == "Abort":
            say("stopped; nothing was written")
            return STOPPED
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):  # the parser's: wrong usage
            say(f"{error.format_message()}\ntype  {_help_of(error)} --help")
            return int(error.exit_code)
        if debug:
            raise
        what = "not enough memory" if isinstance(error, MemoryError) else f"{type(error).__name__}: {error}"
        say(f"an error inside the program ({what}); nothing was written; --debug shows where")
        return 1


def _help_of(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return getattr(context, "command_path", "schuler") or "schuler"


def say(text: str) -> None:
    """To the standard error, where messages belong."""
    print(text, file=sys.stderr, flush=True)
