# The two commands are `make demo` and `make test`; both set up .venv first and reuse it.
SHELL := /bin/bash
BIN := .venv/bin
SECONDS ?=
ROBOTS ?= 3
BENCHMARKS ?=
REPEAT ?= 1
JOBS ?= 4
# Tests here start many processes of their own: two files at a time, as on the two cores that these are run on.
MANY_PROCESSES = tests/deploy tests/integration tests/benchmarks tests/releases
# Python keeps what it compiled, whatever the shell says: the tests start hundreds of processes.
export PYTHONDONTWRITEBYTECODE =
SUMS = cd dist && rm -f SHA256SUMS && sha256sum * >SHA256SUMS && sed 's/^/[dist] /' SHA256SUMS

.PHONY: demo test intended lint types compiled tests again debian ros postgresql chromium nginx containers prometheus helm custom-kinds screenshots bench long chaos fuzz dist bundle clean help

help:  ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## */make \1\t/' | expand -t 14

demo: .venv/.demo  ## run a simulated fleet and watch it (SECONDS=30 stops by itself, ROBOTS=3)
	@exec $(BIN)/fleetsight demo --robots $(ROBOTS) $(if $(SECONDS),--seconds $(SECONDS))

test: intended .venv/bin/python  ## install what the tests need and run every check
	@$(MAKE) --no-print-directory -j 2 .venv/.test debian
	@$(MAKE) --no-print-directory helm custom-kinds lint
	@$(MAKE) --no-print-directory -j 2 types compiled
	@$(MAKE) --no-print-directory tests

# One after the other, as Debian's package manager has it: beside it, pip fills .venv.
debian:
	@for each in ros postgresql chromium nginx containers prometheus; do tests/install/$$each.sh || exit; done

intended:
	@echo "[test] installs what the tests need (up to 5 minutes the first time), checks format, lint and types, and runs"
	@echo "[test] about 15,000 tests: 30 to 60 minutes on 2 cores. A dot is a test that passed; the end says what failed."

lint:
	@echo "[check] format, lint"
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/ruff check --quiet .

types:
	@echo "[check] types"
	@$(BIN)/mypy

# Each of the tests' processes reads all test files, with what pytest adds to their assertions: added once, here.
compiled:
	@$(BIN)/python -m pytest --collect-only --quiet >/dev/null || true  # the tests themselves say what is wrong

tests:
	@echo "[check] tests"
	@run() { $(BIN)/python -m pytest --dist loadfile --no-loadscope-reorder "$$@"; }; failed=0; \
	run -n 2 $(MANY_PROCESSES) || failed=$$?; [ $$failed -le 1 ] || exit $$failed; \
	run -n $(JOBS) $(MANY_PROCESSES:%=--ignore=%) || failed=$$?; \
	[ $$failed = 0 ] || { [ $$failed = 1 ] && $(MAKE) --no-print-directory again; }

again:
	@echo "[check] tests that failed beside others, alone: those that pass now depend on the machine's load, and want mending"
	@$(BIN)/python -m pytest -n 0 --last-failed --last-failed-no-failures none --maxfail 3

ros:
	@tests/install/ros.sh

postgresql:
	@tests/install/postgresql.sh

chromium:
	@tests/install/chromium.sh

nginx:
	@tests/install/nginx.sh

containers:
	@tests/install/containers.sh

prometheus:
	@tests/install/prometheus.sh

helm: .venv/.test
	@tests/install/helm.sh $(BIN)/python

custom-kinds: .venv/.test
	@tests/install/custom_kinds.sh .venv/custom-kinds

screenshots: .venv/.test chromium  ## run the demo and take the pictures that the documentation shows of its page
	@$(BIN)/python -m tests.integration.page.screenshots

bench: .venv/.bench ros  ## run every benchmark and draw what docs show (BENCHMARKS="gateway space", REPEAT=3)
	@$(BIN)/python -m benchmarks $(BENCHMARKS) --repeat $(REPEAT); done=$$?; $(BIN)/python -m benchmarks.plots && exit $$done

long: .venv/.test debian  ## make the image for detectors on a GPU, several GB, and start it
	@$(BIN)/python -m pytest -n 0 -m long

chaos: .venv/.bench debian  ## hurt a small fleet in each way there is, and fail if it loses anything (MINUTES=120 repeats it)
	@$(BIN)/python -m benchmarks.chaos --json --strict --minutes $(or $(MINUTES),0)

fuzz: .venv/.test  ## feed a million spoilt inputs to every parser (INPUTS=10000000 for more)
	@$(BIN)/python -m tests.fuzz --inputs $(or $(INPUTS),1000000)

dist: .venv/.test  ## make what a release has: wheel, sdist, pins, units, images' files and list, chart, SBOMs, notes, checksums, in dist/
	@rm -rf dist && mkdir dist
	@$(BIN)/python -m deploy.release dist
	@$(BIN)/python -m hatchling build -d dist 2>&1 | sed 's/^/[dist] /'
	@cp constraints.txt CHANGELOG.md dist/
	@git archive HEAD deploy | gzip -n >dist/deploy.tar.gz
	@git archive HEAD:deploy/helm fleetsight | gzip -n >dist/fleetsight-$$(sed -n 's/^version: //p' deploy/helm/fleetsight/Chart.yaml).tgz
	@$(BIN)/cyclonedx-py requirements --pyproject pyproject.toml --short-PURLs --output-reproducible -o dist/sbom.cdx.json constraints.txt
	@$(SUMS)

bundle: .venv/.dist  ## make a folder that runs the gateway beside any Python, as an archive in dist/ (EXTRAS=pki,distance,cloud)
	@PYTHON=$(BIN)/python deploy/bundle.sh $(EXTRAS)
	@$(SUMS)

clean:  ## remove the virtual environment and caches
	rm -rf .venv .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

.venv/bin/python:
	@deploy/venv.sh

.venv/.%: pyproject.toml constraints.txt
	@deploy/venv.sh $*
