"""In the tutorials' kernel ``!command`` prints what the command prints, and fails where the command fails."""

import subprocess

from IPython import get_ipython

_shell = get_ipython()


def _checked(command: str) -> None:
    done = subprocess.run(
        _shell.var_expand(command, depth=1),
        shell=True,
        executable="/bin/bash",
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    print(done.stdout, end="")
    if done.returncode:
        raise RuntimeError(f"exit status {done.returncode}: {command}")


_shell.system = _checked
