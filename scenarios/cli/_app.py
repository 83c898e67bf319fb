"""The group of all commands, and the one place where an error becomes a line and an exit status."""

from __future__ import annotations

import logging
import os
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import copy_context
from importlib import import_module
from typing import Any, Final, NoReturn

import click

from rig.errors import LONGEST_MESSAGE, LeftOut, RigError, nearest, one_line, shown
from rig.memory import VARIABLE, WHERE
from rig.patience import is_stuck
from scenarios.cli import _signals
from scenarios.cli._signals import debugging

#: Exit statuses; the last two as the shell gives them for SIGINT and SIGPIPE.
DONE, BAD, USAGE, BUG, INTERRUPTED, UNREAD = 0, 1, 2, 70, 130, 141

#: The commands and the modules that hold them, in the order of the help.
_COMMANDS: Final = {
    "demo": "demo_sweep",
    "sweep": "demo_sweep",
    "import": "importing",
    "check": "importing",
    "calibrate": "calibrate",
    "apply": "calibrate",
    "diagnose": "diagnose",
    "export": "export",
    "compare": "compare",
    "bound": "bound",
    "plan": "plan",
    "study": "study",
    "blind": "_checkout",
    "noise": "noise",
    "live": "live",
    "replay": "live",
    "view": "show",
    "scenarios": "show",
    "effects": "show",
}


#: What click says of a text that is no number.
_NO_NUMBER: Final = re.compile(r"(?<=: )('.*') is not a valid (integer|float)(?: range)?", re.DOTALL)
#: And of a number beyond its range.
_BEYOND: Final = re.compile(r"(?<=: )(\S+) is not in the range (\S+)\.$")
SETTINGS: Final = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


def _command(name: str) -> Any:
    """A command by its name; ``import`` is a word of the language."""
    attribute = {"import": "import_", "blind": "BLIND"}.get(name, name)
    return getattr(import_module(f"scenarios.cli.{_COMMANDS[name]}"), attribute)


class Group(click.Group):
    """A group whose interruptions are ours to report."""

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


class Commands(Group):
    """The commands by name; a module is imported when one of its commands is wanted."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names in the order of the help."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by its name; None where there is none."""
        if cmd_name not in _COMMANDS:
            return None
        command = _command(cmd_name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, but an unknown name is told which names there are."""
        if args and not args[0].startswith("-") and args[0] not in _COMMANDS:
            choices = nearest(args[0], _COMMANDS)
            raise click.UsageError(
                f"unknown command {shown(args[0])}: expected one of {', '.join(_COMMANDS)}{choices}", ctx
            )
        return super().resolve_command(ctx, args)


class _Interrupted(Exception):
    """Ctrl-C or another signal, which click would answer with two lines; its status, and what is said."""

    def __init__(self, error: BaseException) -> None:
        number = error.number if isinstance(error, _signals.Ending) else None
        self.status = INTERRUPTED if number is None else 128 + number
        self.words = "interrupted" if number is None else _signals.WORDS[number]


class _Unread(Exception):
    """The reader of our output has gone, which click would call a failure."""


@contextmanager
def _ending() -> Iterator[None]:
    """Ends that are ours to report, not click's."""
    try:
        yield
    except (KeyboardInterrupt, EOFError) as error:
        raise _Interrupted(error) from None
    except BrokenPipeError:
        raise _Unread from None


@click.group(cls=Commands, invoke_without_command=True, context_settings=SETTINGS)
@click.version_option(package_name="torusrig", prog_name="rig", message="%(prog)s %(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """A robot arm turns an accelerometer and a magnetometer; the rig simulates it and calibrates them.

    Exit status: 0 done, and of a diagnosis whatever its verdict; 1 the answer is bad (a refused fit, a calibration
    that is not good, which is written all the same); 2 the call or its input is wrong. Errors are one line.

    \b
    Example:
      rig demo
      rig sweep ann-arbor -o run.parquet --locked
      rig calibrate run.parquet -o cal.json
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def run(arguments: Sequence[str], group: click.Group = cli, program: str = "rig") -> int:
    """Run a command line without the leading name of the program; errors go to stderr.

    Returns:
        The exit status.
    """
    memory = os.environ.get(VARIABLE)
    try:
        # In a context of its own: what options set is of this command alone.
        own = copy_context()
        own.run(WHERE.set, VARIABLE)
        status = own.run(group.main, list(arguments), prog_name=program, standalone_mode=False)
        with _ending():
            sys.stdout.flush()
        return status if isinstance(status, int) else DONE
    except RigError as error:
        return _fail(str(error), error.exit_status)
    except click.exceptions.NoArgsIsHelpError as error:  # a group alone: its help
        error.show()
        return USAGE
    except click.ClickException as error:
        return _fail(_usage(error), USAGE)
    except _Interrupted as error:
        return _fail(error.words, error.status)
    except (KeyboardInterrupt, click.Abort) as error:
        interrupted = _Interrupted(error)
        return _fail(interrupted.words, interrupted.status)
    except _Unread:
        return _unread()
    except MemoryError as error:
        if debugging():
            raise
        return _fail(f"not enough memory: {one_line(str(error)) or 'for this input'}", USAGE)
    except OSError as error:
        if debugging() or error.strerror is None:
            return _bug(error)
        if error.filename is None:  # all that has no name is what is printed
            _forget_output()
        return _fail(f"{error.filename or 'standard output'}: {error.strerror}", USAGE)
    except Exception as error:
        return _bug(error)
    finally:  # --memory is of this command alone
        os.environ.pop(VARIABLE, None)
        if memory is not None:
            os.environ[VARIABLE] = memory


def main(group: click.Group = cli, program: str = "rig") -> NoReturn:
    """The console command: arguments from the command line, exit status to the shell."""
    _open_standard_streams()
    os.environ["MPLBACKEND"] = "agg"  # pictures are files: no window of the user's choice is opened, or fails to be
    if not debugging():  # what a library has to say to its programmer is not for the user
        warnings.simplefilter("ignore")
        warnings.simplefilter("once", LeftOut)
        warnings.showwarning = _tell
        logging.getLogger().addHandler(logging.NullHandler())
        os.environ.setdefault("RUST_LOG", "off")  # rerun's own log of what is reported anyway
    try:
        status = run(sys.argv[1:], group, program)
    except _signals.Ending as late:  # the same end once more, when it has been said
        status = 128 + late.number
    _signals.ended()
    if is_stuck():
        sys.stdout.flush()
        os._exit(status)
    sys.exit(status)


def _open_standard_streams() -> None:
    """A closed stream is an empty one (else the next file to be opened would take its place), and a letter that the
    terminal does not have is written by its number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            while os.open(os.devnull, os.O_RDWR) < number:
                pass
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))
        elif mode == "w" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _bug(error: Exception) -> int:
    if debugging():
        raise error
    what = f"{type(error).__name__}: {one_line(str(error), 150)}"
    return _fail(f"this is a bug in rig, not in your call: {what} (RIG_DEBUG=1 shows where)", BUG)


def _tell(message: Warning | str, *where: Any, **more: Any) -> None:
    _fail(str(message), DONE)


def _fail(message: str, status: int) -> int:
    """One line on stderr."""
    try:
        print(f"rig: {one_line(message)}", file=sys.stderr)
    except OSError:  # nobody listens
        return _unread()
    return status


def _unread() -> int:
    """End silently, as after ``| head``."""
    _forget_output()
    return UNREAD


def _forget_output() -> None:
    """Let nothing be flushed at exit: it cannot be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _number_wanted(said: re.Match[str]) -> str:
    return f"found {said[1]}, expected a {'whole number' if said[2] == 'integer' else 'number'}"


def _usage(error: click.ClickException) -> str:
    command = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "rig"
    hint = f"; see {command} --help"
    message = _NO_NUMBER.sub(_number_wanted, _BEYOND.sub(r"found \1, expected a number \2", error.format_message()))
    message = one_line(message, LONGEST_MESSAGE - len(hint)).rstrip(".")
    return f"{message[:1].lower()}{message[1:]}{hint}"
