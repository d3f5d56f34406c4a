# Few verbs; `make help` lists them.
PYTHON ?= python3
JOBS ?= 2
GROUPS ?= 29
DATASET ?=
FUZZ ?= 10000
BIN := .venv/bin
DEMO := build/demo
# Training groups stay in a release, about 70 % of all; a near duplicate in another partition does not.
FROZEN = $(shell echo $$(( $(GROUPS) * 3 / 5 )))
.PHONY: setup help demo docs example-highway test thorough check cases conformance compat compat-quick fuzz kills ray bench bench-growth bench-paper bench-release

## create .venv and install into it, in editable mode, with the extras sim, media, plots, report, models, guard, export, conformance and dev
setup: .venv/.installed

.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "BranchDrive needs Python 3.11 or newer; run: make PYTHON=python3.11 $(MAKECMDGOALS)" >&2; exit 1; }
	@echo "setup: installs about 145 packages into .venv, 2.7 GB, once; 1 to 5 minutes, longer on a busy machine, and as long as torch takes to download"
	$(PYTHON) -m venv .venv
	@{ $(BIN)/pip install --disable-pip-version-check --progress-bar off -c constraints.txt \
		-e ".[sim,media,plots,report,models,guard,export,conformance,dev]"; echo $$? > .venv/status; } | { n=0; while read -r what name rest; do case "$$what" in \
			Collecting|Processing) n=$$((n + 1)); name=$${name##*/}; echo "setup: $$n $${name%%-[0-9]*}";; \
			Installing) [ "$$name" != collected ] || echo "setup: installing all $$n of them";; esac; done; }
	@read status < .venv/status; [ $$status -eq 0 ] || \
		{ echo "setup: pip ended with $$status; what it said is above. To go on, run: make setup" >&2; exit 1; }
	@touch $@

## list the verbs
help:
	@awk '/^## / { text = substr($$0, 4); next } \
		text { split($$0, part, ":"); printf "make %-14s %s\n", part[1], text } \
		{ text = "" } \
		END { print "variables: PYTHON=$(PYTHON) JOBS=$(JOBS) GROUPS=$(GROUPS) DATASET=$(DATASET) FUZZ=$(FUZZ)" }' $(MAKEFILE_LIST)

## collect one group of every scenario type in the reference world, build a release of them, validate it, draw them, report on it
demo: setup
	@[ $(GROUPS) -ge 5 ] || \
		{ echo "a release has three partitions, which takes five groups; run: make demo GROUPS=5" >&2; exit 1; }
	@rm -rf $(DEMO) && mkdir -p $(DEMO)
	$(BIN)/branchdrive collect $(DEMO)/dataset --preset demo --groups $(GROUPS) --seed 1 --jobs $(JOBS)
	$(BIN)/branchdrive build $(DEMO)/dataset --jobs $(JOBS)
	$(BIN)/branchdrive-validate $(DEMO)/dataset --jobs $(JOBS) --require-groups $(FROZEN)
	$(BIN)/branchdrive draw $(DEMO)/dataset --output $(DEMO)/pictures
	$(BIN)/branchdrive report $(DEMO)/dataset --output $(DEMO)/report.html --jobs $(JOBS)
	@echo "demo: open $(DEMO)/report.html"

## collect 20 groups from highway-env, build a release of them, validate it, report on it as a pilot; film two more
example-highway: setup
	@$(BIN)/python -c 'import highway_env' 2>/dev/null || \
		$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[bench]"
	@rm -rf build/highway && mkdir -p build
	$(BIN)/python -m examples.highway_env.collector build/highway --groups 20 --jobs $(JOBS)
	$(BIN)/branchdrive build build/highway --jobs $(JOBS)
	$(BIN)/branchdrive-validate build/highway --jobs $(JOBS)
	$(BIN)/branchdrive pilot build/highway || [ $$? -eq 1 ]
	@rm -rf build/highway-filmed
	$(BIN)/python -m examples.highway_env.filmed build/highway-filmed --groups 2 --jobs $(JOBS)
	$(BIN)/branchdrive-validate build/highway-filmed --jobs $(JOBS)

## build the site of docs, spec, rules and API into build/site; a link that leads nowhere is an error
docs: setup
	@$(BIN)/python -c 'import zensical, mkdocstrings_handlers.python' 2>/dev/null || \
		$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[docs]"
	$(BIN)/python -m docs.site

## the tests, of alike cases a sample
test: setup
	$(BIN)/pytest -q -n $(JOBS) --dist worksteal

## the whole breadth of what tests of the suite sample: every defect, kills anywhere, every kernel, every change
thorough: setup
	$(BIN)/pytest -q -n $(JOBS) --dist worksteal -m thorough

## write the conformance cases from the registered defects, and all of them as one archive with its digest
cases: setup
	$(BIN)/python -m tests.conformance_cases --jobs $(JOBS) --archive build/conformance-cases.tar.gz

## hold the conformance cases against the registered defects, and the validator against the cases
conformance: setup
	$(BIN)/python -m tests.conformance_cases --check --jobs $(JOBS)
	$(BIN)/branchdrive-conformance validator --jobs $(JOBS)

## the tests with lowest and newest versions of libraries, on every Python from 3.11 to 3.13 that is found, and as three processors calculate
compat: setup
	$(BIN)/python -m tests.compatibility --jobs $(JOBS)

## install the extra ray, and run the tests that need it
ray: setup
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[ray]"
	$(BIN)/pytest -q tests/validator/runtime/test_ray_executor.py tests/repo/test_operators_page.py \
		tests/reference_impl/collect/test_on_ray.py tests/reference_impl/rendering/test_on_ray.py \
		tests/reference_impl/benchmark/test_on_ray.py

## the part of compat that continuous integration runs
compat-quick: setup
	$(BIN)/python -m tests.compatibility --quick --jobs $(JOBS)

## damage valid datasets of all layers in FUZZ ways and see that each ends in a verdict; a run goes on where it stopped
fuzz: setup
	$(BIN)/python -m tests.fuzz --cases $(FUZZ) --jobs $(JOBS)

## kill collector, builder and benchmark 100 times each, and compare what they end with
kills: setup
	$(BIN)/python -m tests.kills

## style, types, import contracts, generated files
check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m branchdrive.contract.generate --check

## simulator ticks/s, alone and against highway-env, and validation against read + hash + decode of the same bytes
bench: setup
	@$(BIN)/python -c 'import highway_env' 2>/dev/null || \
		$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[bench]" || \
		echo "highway-env cannot be installed; the table goes without it" >&2
	$(BIN)/python -m benchmarks

## growth of validation, build and audit up to 16,000 repeated groups: processor time, the parent's memory, exponents
bench-growth: setup
	$(BIN)/python -m benchmarks --growth

## collect and validate a dataset of the paper's size: time, memory, funnel
bench-paper: setup
	$(BIN)/python -m benchmarks --paper

## build, validate and benchmark a release of the preset benchmark: time, memory, population, leakage gate; of DATASET where one is named
bench-release: setup
	$(BIN)/python -m benchmarks --release $(if $(DATASET),--dataset "$(DATASET)")
