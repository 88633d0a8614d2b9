# `make demo` and `make test` work from a bare clone: each sets up .venv first when it has to.
.DEFAULT_GOAL := help
.NOTPARALLEL:
# Modules are compiled once, and not again in each process of the tests, of which there are hundreds.
unexport PYTHONDONTWRITEBYTECODE
.PHONY: help demo studio quick test test-slow test-devices mutants clients bundle docs lint types prove faults size setup clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' Makefile

demo: .venv/.ready ## render a texture end to end, no hardware needed, into haptix-demo/ (ARGS=...)
	.venv/bin/haptix demo --out haptix-demo $(ARGS)

studio: .venv/.ready ## open the studio in a browser, no hardware needed (ARGS='--device usb:')
	.venv/bin/haptix studio $(ARGS)

test: .venv/.ready ## run the tests (ARGS='-k surface -x')
	.venv/bin/python -m pytest -n auto --dist loadfile $(ARGS)

quick: .venv/.ready ## the tests nearest to the files that you changed, for a minute (ARGS='haptix/model/screen.py -x')
	.venv/bin/python scripts/quick.py $(ARGS)

test-slow: .venv/.ready ## the tests that make test leaves out for their time
	.venv/bin/python -m pytest -n auto --dist loadfile -m slow $(ARGS)

test-devices: .venv/.ready ## the tests through real USB, HID, touchscreen and audio stacks (first: bash scripts/setup-devices.sh)
	.venv/bin/python -m pytest -m devices tests/devices tests/examples tests/lab $(ARGS)

mutants: .venv/.ready ## 300 small errors in the packages, each for the tests nearest to it (ARGS='--count 40 haptix/play/render'); hours
	.venv/bin/python scripts/mutants.py $(ARGS)

bundle: ## this system's bundle with a window, Python and PyTorch, by PyInstaller; minutes (TORCH_INDEX=... for the processor's PyTorch)
	bash scripts/bundle.sh

test-peers: .venv/.ready ## the field's own tools read what haptix writes (first: bash scripts/setup-peers.sh)
	.venv/bin/python -m pytest -m peers tests/peers $(ARGS)

clients: .venv/.ready ## the clients' types and messages, from the schema; needs Node 20 (ARGS='--pack FOLDER' for a release)
	.venv/bin/python scripts/make-clients.py $(ARGS)

docs: .venv/.ready ## the site, into site/: guides and the API reference; a broken link or a blank page fails
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build

lint: .venv/.ready ## rules and format (ruff), the import contract (import-linter); nothing is changed
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/lint-imports --no-logo

types: .venv/.ready ## mypy, tests included
	.venv/bin/mypy

prove: ## what the contracts of the firmware's limiter say, by Frama-C and Z3
	@$(MAKE) --no-print-directory -C tests/firmware_io/firmware prove

faults: ## a failure at each step of 1,000 sessions, and a million flipped bits of the firmware's memory
	@$(MAKE) --no-print-directory -C tests/firmware_io/firmware faults

size: .venv/.ready ## code, stack and cycles of the firmware's functions on a Cortex-M, since the last release (ARGS=--store)
	.venv/bin/python benchmarks/firmware_size.py $(ARGS)

setup: ## set up again, or mend, .venv (PYTHON=... picks the interpreter)
	@bash scripts/setup.sh

clean: ## remove caches and outputs; .venv stays
	rm -rf haptix-demo my.surface dist build site clients/asyncapi.json .benchmarks .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . \( -name .venv -o -name .git \) -prune -o -name __pycache__ -type d -exec rm -rf {} +

# Written by setup.sh as its last act, so an interrupted set-up is taken up again.
.venv/.ready: pyproject.toml constraints.txt scripts/setup.sh
	@bash scripts/setup.sh
