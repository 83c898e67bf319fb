"""The group of all commands, and the one place where an error becomes a line and an exit status."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Final, NoReturn

import click

from rig.errors import RigError, nearest

#: Exit statuses beside a RigError's own (1 or 2); the last two as the shell gives them for SIGINT and SIGPIPE.
DONE, USAGE, BUG, INTERRUPTED, UNREAD = 0, 2, 70, 130, 141

#: The commands and the modules that hold them, in the order of the help.
_COMMANDS: Final = {
    "demo": "run",
    "sweep": "run",
    "calibrate": "calibrate",
    "apply": "calibrate",
    "diagnose": "diagnose",
    "export": "export",
    "bound": "bound",
    "study": "study",
    "blind": "blind",
    "noise": "noise",
    "view": "show",
    "scenarios": "show",
    "effects": "show",
}


_SETTINGS: Final = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class Commands(click.Group):
    """The commands by name; a module is imported when one of its commands is wanted."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names in the order of the help."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by its name; None where there is none."""
        if cmd_name not in _COMMANDS:
            return None
        command = getattr(import_module(f"scenarios.cli.{_COMMANDS[cmd_name]}"), cmd_name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, but an unknown name is told which names there are."""
        if args and not args[0].startswith("-") and args[0] not in _COMMANDS:
            choices = nearest(args[0], _COMMANDS)
            raise click.UsageError(f"unknown command {args[0]!r}: expected one of {', '.join(_COMMANDS)}{choices}", ctx)
        return super().resolve_command(ctx, args)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Read the options, among them those that print and end."""
        with _ending():
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> object:
        """Run the command."""
        with _ending():
            return super().invoke(ctx)


class _Interrupted(Exception):
    """Ctrl-C, which click would answer with two lines."""


class _Unread(Exception):
    """The reader of our output has gone, which click would call a failure."""


@contextmanager
def _ending() -> Iterator[None]:
    """Ends that are ours to report, not click's."""
    try:
        yield
    except (KeyboardInterrupt, EOFError):
        raise _Interrupted from None
    except BrokenPipeError:
        raise _Unread from None


@click.group(cls=Commands, invoke_without_command=True, context_settings=_SETTINGS)
@click.version_option(package_name="torusrig", prog_name="rig", message="%(prog)s %(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """A robot arm turns an accelerometer and a magnetometer; the rig simulates it and calibrates them.

    Exit status: 0 done; 1 no answer worth having (a refused fit); 2 the call or its input is wrong. Errors are one
    line.

    \b
    Example:
      rig demo
      rig sweep ann-arbor -o run.parquet --locked
      rig calibrate run.parquet -o cal.json
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def run(arguments: Sequence[str]) -> int:
    """Run a command line without the leading ``rig``; errors go to stderr.

    Returns:
        The exit status.
    """
    try:
        status = cli.main(list(arguments), prog_name="rig", standalone_mode=False)
        with _ending():
            sys.stdout.flush()
        return status if isinstance(status, int) else DONE
    except RigError as error:
        return _fail(str(error), error.exit_status)
    except click.ClickException as error:
        return _fail(_usage(error), USAGE)
    except (_Interrupted, KeyboardInterrupt, click.Abort):
        return _fail("interrupted", INTERRUPTED)
    except _Unread:
        return _unread()
    except OSError as error:
        if _debugging() or error.strerror is None:
            return _bug(error)
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror}", USAGE)
    except Exception as error:
        return _bug(error)


def main() -> NoReturn:
    """The console command: arguments from the command line, exit status to the shell."""
    if not _debugging():  # what a library has to say to its programmer is not for the user
        warnings.simplefilter("ignore")
        logging.getLogger().addHandler(logging.NullHandler())
    sys.exit(run(sys.argv[1:]))


def _debugging() -> bool:
    return os.environ.get("RIG_DEBUG", "") not in ("", "0")


def _bug(error: Exception) -> int:
    if _debugging():
        raise error
    return _fail(
        f"this is a bug in rig, not in your call: {type(error).__name__}: {error} (RIG_DEBUG=1 shows where)", BUG
    )


def _fail(message: str, status: int) -> int:
    """One line on stderr."""
    try:
        print(f"rig: {' '.join(message.split())}", file=sys.stderr)
    except OSError:  # nobody listens
        return _unread()
    return status


def _unread() -> int:
    """End silently, as after ``| head``, and let nothing be flushed at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return UNREAD


def _usage(error: click.ClickException) -> str:
    message = error.format_message().strip().rstrip(".")
    command = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "rig"
    return f"{message[:1].lower()}{message[1:]}; see {command} --help"
