"""``python -m scenarios.cli`` is the console command ``rig``."""

from scenarios.cli import main

if __name__ == "__main__":
    main()
