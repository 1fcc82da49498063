"""`stereocalib`: parses the command line, runs one command, and turns what goes wrong into one line."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from stereocalib_app.cli.arguments import build_parser
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.system.installed_code import use_installed_code

EXIT_OK, EXIT_BAD_INPUT, EXIT_UNTRUSTED, EXIT_INTERRUPTED = 0, 2, 3, 130


def main(argv: Sequence[str] | None = None) -> int:
    """The command line's exit code; errors are one line on stderr."""
    if argv is None:
        # as an exit, so that what was unpacked into temporary folders goes
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        arguments = build_parser().parse_args(argv)
        use_installed_code()
        from stereocalib_app.cli import commands

        warning = commands.COMMANDS[arguments.command](arguments)
        sys.stdout.flush()
    except StereoCalibError as error:
        return _fail(str(error))
    except KeyboardInterrupt as stopped:
        print(f"stereocalib: stopped: {stopped}" if str(stopped) else "stereocalib: stopped", file=sys.stderr)
        if argv is None:
            _leave_at_once(EXIT_INTERRUPTED)
        return EXIT_INTERRUPTED
    except SystemExit as told:
        # Told to go: what was uploaded and unpacked is gone by now.
        if argv is None and told.code == 128 + signal.SIGTERM:
            _leave_at_once(128 + signal.SIGTERM)
        raise
    except BrokenPipeError:
        # Whoever read our output has gone; nothing can be said there any more.
        sys.stdout = None
        return EXIT_OK
    except OSError as error:
        where = error.filename or "the system"
        return _fail(
            f"{(error.strerror or 'input or output failed').lower()}: {where}: check path, rights and space"
        )
    except MemoryError:
        return _fail("out of memory: this machine: use fewer frames, --frames A:B")
    if warning:
        print(f"stereocalib: not to be trusted: {warning}", file=sys.stderr)
        return EXIT_UNTRUSTED
    return EXIT_OK


def _leave_at_once(code: int) -> NoReturn:
    """End the process without the interpreter's teardown, which aborts where a thread is still inside native code."""
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _fail(line: str) -> int:
    print(f"stereocalib: error: {' '.join(line.split())}", file=sys.stderr)
    return EXIT_BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
