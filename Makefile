PYTHON ?= python
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1

.PHONY: check test test-fast bench build

check:  ## lint, format and types
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m pyright

test:  ## everything that this machine can run
	$(PYTHON) -m pytest

test-fast:  ## laws and units: no browser, no real time, no robot wire, nothing slow
	$(PYTHON) -m pytest -m "not browser and not realtime and not hardware and not slow"

bench:  ## every benchmark, the short form
	for name in estimator estimator_contact estimator_robustness policy box_drag training loop recording; do \
		$(PYTHON) -m sim.benchmarks.$$name --quick || exit 1; done

build:  ## wheel and sdist in dist/, each installed and started outside the checkout
	bash .ci/packages.sh
