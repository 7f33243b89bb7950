# make demo      the main job, on an embedded mission          make quick     tests without the slow ones
# make test      everything that must hold                     make bench     speed of the main tasks
# make evidence  the figures of the README, measured again     make lock      pins what is installed now
# make kernels   after a change of the kernels: what a first start compiles on all cores
# make peers     installs the programs that some benchmarks are held against (python-ins, vqf, allantools)
#
# All of them first make what they need: a virtual environment in .venv (PYTHON says with which Python, 3.11 or newer).

PYTHON ?= python3
PY := .venv/bin/python
STAMP := .venv/.installed
JOBS ?= 2

.DEFAULT_GOAL := demo
.PHONY: demo test quick bench evidence setup lock lint warm kernels peers

demo: setup
	@.venv/bin/schuler demo --out demo-result

setup: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; type  make PYTHON=python3.12  (or the one you have)" >&2; exit 1; }
	@echo "installing into .venv (once; about a minute) ..."
	@test -x $(PY) || $(PYTHON) -m venv .venv || \
	  { echo "no virtual environment could be made; on Debian and Ubuntu install python3-venv" >&2; exit 1; }
	@$(PY) -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	@$(PY) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $(STAMP)

lint: setup
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

# Compiled before the tests' processes start: several that compile the same kernels at once can spoil numba's cache.
warm: setup
	.venv/bin/schuler warmup

test: lint warm
	$(PY) -m pytest -n $(JOBS)

quick: setup warm
	$(PY) -m pytest -n $(JOBS) -m "not slow"

bench: setup warm peers
	$(PY) benchmarks/speed.py

evidence: setup warm peers
	$(PY) benchmarks/evidence.py

kernels: setup
	$(PY) -m schuler.studies.precompile record

peers: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check --no-deps --requirement requirements-peers.lock

lock:
	$(PY) tools/lock.py
