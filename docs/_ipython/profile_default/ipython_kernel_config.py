"""The kernel listens on 127.0.0.1 only, so its warning of unencrypted messages is left out."""

c.IPKernelApp.log_level = "ERROR"  # type: ignore[name-defined]  # noqa: F821
