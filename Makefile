# Few verbs: setup, demo, test, check, bench.
PYTHON ?= python3
JOBS ?= 2
GROUPS ?= 12
BIN := .venv/bin
DEMO := build/demo

.PHONY: setup demo test check bench

setup: .venv/.installed

.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "BranchDrive needs Python 3.11 or newer; run: make PYTHON=python3.11 $(MAKECMDGOALS)" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[sim,dev]"
	@touch $@

## collect a small dataset in the reference world, validate it, show the result
demo: setup
	@rm -rf $(DEMO) && mkdir -p $(DEMO)
	$(BIN)/branchdrive collect $(DEMO)/dataset --groups $(GROUPS) --seed 7 --jobs $(JOBS)
	$(BIN)/branchdrive-validate $(DEMO)/dataset --jobs $(JOBS) --require-groups $(GROUPS)

## the whole test suite
test: setup
	$(BIN)/pytest -q -n $(JOBS) --dist worksteal

## style, types, import contracts, generated files
check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m branchdrive.contract.generate --check

## simulator ticks/s, and validation against read + hash + decode of the same bytes
bench: setup
	$(BIN)/python -m branchdrive_reference.bench
