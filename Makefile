# `make run` does the main job, `make test` runs all tests; both share .venv.

PORO := .venv/bin/porocore
RUN ?= runs/dehghani2022

.PHONY: run test test-slow coverage lint docs dist benchmarks clean

run: .venv/.ready-run
	$(PORO) run --out $(RUN) --resume

test: .venv/.ready-test
	sh tools/test.sh

# Everything, the tests marked slow included.
test-slow: .venv/.ready-test
	sh tools/test.sh --run-slow

# The fast tests once more, with the lines of core and plugins that they run; pages below build/coverage.
coverage: .venv/.ready-test
	sh tools/test.sh --cov=porocore --cov=plugins --cov-report=term:skip-covered --cov-report=html:build/coverage

lint: .venv/.ready-test
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml

# The site, below build/docs.
docs: .venv/.ready-test
	.venv/bin/python -m sphinx -W --keep-going -c docs -b html . build/docs

# The distributions, in dist/: built, and tried in empty environments, which fetches what they need (some 2 GB on the disk).
dist: .venv/.ready-test
	.venv/bin/python tools/distributions.py --out dist
	POROCORE_DIST=dist .venv/bin/python -m pytest --run-slow tests/release

benchmarks: .venv/.ready-test
	.venv/bin/python benchmarks/run.py

.venv/.ready-%: tools/setup.sh $(wildcard constraints/*.txt) pyproject.toml $(wildcard plugins/*/pyproject.toml)
	sh tools/setup.sh $*

clean:
	rm -rf .venv runs build dist
