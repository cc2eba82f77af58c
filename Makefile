# Everything a person or CI does here. A bare Python 3.11+ with pip is enough; nothing is written outside this folder.
PYTHON ?= python3

export TMPDIR := $(CURDIR)/.cache/tmp
export UV_CACHE_DIR := $(CURDIR)/.cache/uv
export UV_PYTHON_DOWNLOADS := never
unexport PYTHONDONTWRITEBYTECODE # set, every worker and command of the tests compiles all modules anew
export MPLCONFIGDIR := $(CURDIR)/.cache/matplotlib
# The type checker stays with the locked version instead of asking for a newer one.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

$(shell mkdir -p "$(TMPDIR)")
BIN := .venv/bin
READY := .venv/.ready
UV := .tools/bin/uv

.DEFAULT_GOAL := help
.PHONY: help setup native demo browser test check docs claims mutants fuzz pictures screens follow same size package lock clean

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/make \1\t\2/p' Makefile

setup: native ## the environment, in .venv, and the kernels

native: $(READY) ## the kernels, compiled ahead of time; at once where they are
	@$(BIN)/python native_build.py

demo: $(READY) ## the whole chain on a made-up session, into demo/
	@$(BIN)/python native_build.py --first
	$(BIN)/python examples/demo.py

browser: ## chromium, from Debian's packages where there is none: the tests of the page open it
	@command -v chromium > /dev/null || { apt-get update -qq && apt-get install -qq -y --no-install-recommends chromium; }

# Three workers keep two cores at work while a test waits.
test: native ## the tests; those of the page skip without chromium
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 3 --dist worksteal

check: $(READY) ## style, types, import directions
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright
	$(BIN)/lint-imports

docs: $(READY) ## the pages, into docs/_build
	$(BIN)/sphinx-build -E -W --keep-going -q docs docs/_build/html

claims: native ## every claim with its figure, into docs/evidence.md and the papers' pages; ONLY="NAME ..." some of them
	$(BIN)/python -m claims $(if $(ONLY),--only $(ONLY))

mutants: $(READY) ## faults by chance (SEED=0), turned on one by one: do the tests of their room notice?
	$(BIN)/python -m mutants --seed $(or $(SEED),0)

fuzz: $(READY) ## fuzz each reader, packet and message of a page (MINUTES=10): hours; needs atheris, installed beside
	@test -d .cache/atheris || $(UV) pip install --quiet --python $(BIN)/python --target .cache/atheris atheris
	PYTHONPATH=.cache/atheris $(BIN)/python -m fuzz --minutes $(or $(MINUTES),10) $(ONLY)

pictures: native ## the pictures of README and pages, into docs/pictures, from what `make demo` left
	$(BIN)/python docs/pictures/make.py

screens: native ## pictures of every page in a browser, at a desk and on a phone, into .cache/screens; minutes
	$(BIN)/python -m tests.screens .cache/screens

follow: native ## the README, tutorials and more, word by word as a newcomer would; minutes; PAGES=today one of them in turn
	$(BIN)/python -m tests.follow $(PAGES)

same: native ## answers of this checkout and of BASE=COMMIT over the same inputs, to the last bit; minutes
	$(BIN)/python -m tests.same "$(BASE)"

size: $(READY) ## lines of code by room, beside those of BASE=COMMIT if that is given
	$(BIN)/python -m tests.size "$(BASE)"

package: $(READY) ## wheel and sdist, built and used in bare environments of each Python that is here; minutes each
	$(BIN)/python -m tests.package

lock: $(UV) ## requirements.lock from pyproject.toml
	$(UV) pip compile pyproject.toml --all-extras --group dev --group docs --python-version 3.11 --universal \
		--generate-hashes --no-header --no-annotate --upgrade --quiet --output-file requirements.lock

clean: ## back to a fresh clone
	rm -rf .venv .tools .cache src/palpate/_native .pytest_cache .ruff_cache .import_linter_cache .hypothesis docs/_build demo
	find src tests claims examples fuzz mutants ros2 -name __pycache__ -exec rm -rf {} +

$(UV):
	@$(PYTHON) -c 'import sys; sys.exit("Palpate needs Python 3.11 or newer; name one: make setup PYTHON=python3.11" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m pip install --quiet --no-cache-dir --root-user-action=ignore --upgrade --target .tools uv

$(READY): $(UV) requirements.lock pyproject.toml
	$(UV) venv --quiet --allow-existing --python "$(PYTHON)" .venv
	$(UV) pip sync --quiet --python $(BIN)/python --require-hashes requirements.lock
	PALPATE_NATIVE=0 $(UV) pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
	@touch $@
