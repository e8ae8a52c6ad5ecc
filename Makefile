# `make run` does the main job, `make test` runs all tests; both share .venv.
# NEWEST=1 takes the newest release of every package instead of the pins, in .venv-newest.

export NEWEST
VENV := .venv$(if $(NEWEST),-newest)
PORO := $(VENV)/bin/porocore
RUN ?= runs/dehghani2022

.PHONY: run test test-slow coverage lint docs dist benchmarks clean

run: $(VENV)/.ready-run
	$(PORO) run --out $(RUN) --resume

test: $(VENV)/.ready-test
	sh tools/test.sh

# Everything, the tests marked slow included.
test-slow: $(VENV)/.ready-test
	sh tools/test.sh --run-slow

# The fast tests once more, with the lines of core and plugins that they run; pages below build/coverage.
coverage: $(VENV)/.ready-test
	sh tools/test.sh --cov=porocore --cov=plugins --cov-report=term:skip-covered --cov-report=html:build/coverage

lint: $(VENV)/.ready-test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/mypy --platform win32 --cache-dir .mypy_cache/win32
	$(VENV)/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml

# The site, below build/docs.
docs: $(VENV)/.ready-test
	$(VENV)/bin/python -m sphinx -W --keep-going -c docs -b html . build/docs

# The distributions, in dist/: built, and tried in empty environments, which fetches what they need (some 2 GB on the disk).
dist: $(VENV)/.ready-test
	$(VENV)/bin/python tools/distributions.py --out dist
	POROCORE_DIST=dist $(VENV)/bin/python -m pytest --run-slow tests/release

benchmarks: $(VENV)/.ready-test
	$(VENV)/bin/python benchmarks/run.py

$(VENV)/.ready-%: tools/setup.sh $(wildcard constraints/*.txt) pyproject.toml $(wildcard plugins/*/pyproject.toml)
	sh tools/setup.sh $*

clean:
	rm -rf .venv .venv-newest runs build dist
