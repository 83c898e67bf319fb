# make demo    the whole story on the built-in scenario; recording, calibration, plots and .rrd land in ./out
# make test    the tests                  make lint    ruff and mypy
# make docs    the documentation as a site in docs/_build/html, its tutorials run, its pages opened in Chromium
# make bench   the benchmarks, beside the packages people use today
# make lock    newest versions within pyproject.toml's ranges, with their hashes
# make clean   everything made here, but the environments; make distclean these too
#
# Needs Python 3.11 to 3.13 (with venv and pip), make and bash. Another interpreter: make PYTHON=/path/to/python3.12 demo

SHELL := bash
.DEFAULT_GOAL := demo
.DELETE_ON_ERROR:
.PHONY: demo test lint docs bench lock clean distclean

PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	"$$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null && echo "$$python" && break; done)
WORKERS ?= 2
ARGS ?=

# One BLAS thread: two of them make small fits erratic.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
export VECLIB_MAXIMUM_THREADS ?= 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# $(call locked_install,ENVIRONMENT,LOCK,OPTIONS): the lock's versions and hashes. One line counts on, on a terminal;
# pip's warnings are shown where it fails. It compiles on one processor, after all else; compileall on all of them, where
# some old file may not compile.
locked_install = set -o pipefail; \
	"$(1)/bin/python" -m pip install --progress-bar off --no-compile $(3) --require-hashes --requirement "$(2)" 2>"$(1)/pip.log" | awk \
	-v total="$$(grep -c == "$(2)")" \
	'BEGIN { live = !system("test -t 1"); printf "$(1): packages of $(2)"; fflush() } \
	/^(Collecting|Processing|Requirement already)/ && live { printf "\r$(1): package %d of %d ", ++n, total; fflush() } \
	/^Installing/ { printf ", installing them"; fflush() } \
	END { print "" }' || { cat "$(1)/pip.log" >&2; exit 1; }; \
	"$(1)/bin/python" -m compileall -qq -j 0 "$(1)/lib" || true

demo: .venv/.installed
	CI=1 .venv/bin/rig demo $(ARGS)  # rerun reports no usage to its makers where CI is set

test: .venv/.dev
	.venv/bin/pytest -n $(WORKERS) --dist worksteal $(ARGS)

lint: .venv/.dev
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy

docs: .venv/.docs
	.venv/bin/sphinx-build -W --keep-going -b html docs docs/_build/html
	.venv/bin/python docs/check_pages.py docs/_build/html

bench: .venv-bench/.installed
	.venv-bench/bin/python -m benchmarks $(ARGS)

# No index address is written, so that the locks say what is installed and the user's own settings say where from.
lock: compile = .venv/bin/uv pip compile --quiet --upgrade --python-version 3.11 --universal \
	--fork-strategy fewest --generate-hashes --no-annotate --no-emit-index-url --custom-compile-command "make lock"
lock: .venv/.dev
	$(compile) --extra cluster --extra place --group dev --group backend --output-file dev.lock pyproject.toml
	$(compile) --group backend --constraint dev.lock --output-file requirements.lock pyproject.toml
	$(compile) --group peers --constraint dev.lock --output-file bench.lock
	$(compile) --group docs --constraint dev.lock --output-file docs.lock

.venv/.installed: pyproject.toml requirements.lock
	@$(if $(PYTHON),,echo "no Python 3.11 to 3.13 found: name one, as in make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)" >&2; exit 1)
	@test -x .venv/bin/python || "$(PYTHON)" -m venv .venv
	@$(call locked_install,.venv,requirements.lock,)
	@.venv/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

# What tests, and what builds the site, are added to the environment; the locks have one version of what they share.
.venv/.dev: dev.lock .venv/.installed
	@$(call locked_install,.venv,dev.lock,)
	@touch $@

.venv/.docs: docs.lock .venv/.dev
	@$(call locked_install,.venv,docs.lock,)
	@touch $@

# The peers stay out of the environment that is tested. Their own version limits cannot all be met at once (see
# pyproject.toml), hence --no-deps: the lock is complete.
.venv-bench/.installed: pyproject.toml dev.lock bench.lock
	@$(if $(PYTHON),,echo "no Python 3.11 to 3.13 found: name one, as in make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)" >&2; exit 1)
	@test -x .venv-bench/bin/python || "$(PYTHON)" -m venv .venv-bench
	@$(call locked_install,.venv-bench,dev.lock,)
	@$(call locked_install,.venv-bench,bench.lock,--no-deps)
	@.venv-bench/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

clean:
	rm -rf out dist build docs/_build docs/reference/effects .hypothesis .mypy_cache .pytest_cache .ruff_cache mutants
	find benchmarks docs documenting estimators rig scenarios tests validation -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

distclean: clean
	rm -rf .venv .venv-bench
