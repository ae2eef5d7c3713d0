# The same commands for people and for continuous integration.
PYTHON ?= python3
HOST = 127.0.0.1
SET = report
BUILD = buildah bud --isolation chroot --layers
JOBS = 200
FAULTS = 60
SEED = 1
# tests wait for services at times, so one worker more than processors, up to four; with more of
# them more services idle beside the tests, and all take as long
WORKERS = $(shell n=$$(nproc); echo $$((n < 3 ? n + 1 : 4)))
BIN := .venv/bin
INSTALLED := .venv/installed
COMPILED := .venv/compiled

.DEFAULT_GOAL := help
.PHONY: help setup demo test pytest lint programs evaluate bench chaos serve image openapi docs clean

help:  ## Show this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/\1\t\2/p' Makefile | expand -t 12

setup: $(COMPILED)  ## Put everything into .venv; the command is .venv/bin/lightlayers then

demo: setup  ## Have the simulated camera take a pair, separate it, put the results into demo/
	$(BIN)/python -m service.demo

test: lint pytest  ## Run every check and every test

pytest: $(COMPILED) programs
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder

lint: $(INSTALLED)  ## Check style, types and the import rules
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

programs: $(INSTALLED)
	@.ci/test-programs

evaluate: setup  ## Measure on rendered scenes what is promised; SET=development for tuning
	$(BIN)/python -m tests.evaluation --set $(SET)
	$(BIN)/python -m tests.evaluation.normals --set $(SET)
	$(BIN)/python -m tests.evaluation.editing --set $(SET)
	$(BIN)/python -m tests.evaluation.known_lamps --set $(SET)
	$(BIN)/python -m tests.evaluation.calibration $(if $(filter development,$(SET)),--set $(SET))
	$(BIN)/python -m tests.evaluation.warnings
	$(BIN)/python -m tests.evaluation.found_marks

bench: setup  ## Measure what jobs cost, into docs/; QUICK=1 prints the kernel, one job and a start
	$(BIN)/python -m tests.bench $(if $(QUICK),--quick)

chaos: setup  ## Break a service in every way, and account for each job; JOBS=20 FAULTS=6 SEED=1
	$(BIN)/python -m tests.chaos --setup sqlite --jobs $(JOBS) --faults $(FAULTS) --seed $(SEED)
	$(BIN)/python -m tests.chaos --setup postgresql --jobs $(JOBS) --faults $(FAULTS) --seed $(SEED)

serve: setup  ## Serve on http://localhost:8000; HOST=0.0.0.0 for phones, once there is a key
	$(BIN)/lightlayers serve --host $(HOST)

image: setup  ## Build the image with buildah, as root, and run the compose file's services from it
	$(BUILD) -f docker/Dockerfile -t lightlayers .
	$(BIN)/pytest tests/integration/service/image_run.py

openapi: setup  ## Write openapi.json from the app
	$(BIN)/python -m service.openapi > openapi.json.new
	mv openapi.json.new openapi.json

docs: setup openapi  ## Build the pages of docs/ into a site, build/site
	$(BIN)/python -m service.reference docs/reference
	$(BIN)/sphinx-build -W -q docs build/site

clean:  ## Remove what setup, demo and the tools made; jobs in .lightlayers stay
	rm -rf .venv build demo *.egg-info .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(INSTALLED): requirements-build.lock requirements-dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("lightlayers needs \
	Python 3.11 or newer, and $(PYTHON) is %d.%d: install a newer one and name it, as in \
	make PYTHON=python3.12 setup" % sys.version_info[:2])'
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || .ci/apt-install python3-venv
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check --require-hashes \
		-r requirements-build.lock -r requirements-dev.lock
	$(BIN)/python -m pip install --disable-pip-version-check --no-build-isolation --no-deps -e .
	@touch $@

# code belongs to one version of pipeline/, and is compiled anew when a file of it changes; byte code
# is kept where PYTHONDONTWRITEBYTECODE is set, too: else every process would make it anew
$(COMPILED): $(INSTALLED) $(shell find pipeline -name '*.py')
	$(BIN)/python -m compileall -q drivers pipeline service
	$(BIN)/python -m service.compile
	@touch $@
