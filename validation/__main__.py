"""``python -m validation``: see ``validation.cli``."""

from scenarios.cli import _signals

if __name__ == "__main__":
    with _signals.heard():
        from scenarios.cli._app import main
        from validation.cli import validation

        main(validation, "python -m validation")
