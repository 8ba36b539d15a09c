# Needs Linux x86-64, make and Python 3.11 or 3.12 with venv; everything else is installed into .venv from requirements.lock.
#   make demo                              the default scenario as four node processes and a recorder; results in out/demo/
#   make test [ARGS="tests/cli -k help"]   the test suite
#   make lint | format | lock | clean
# A particular interpreter: make PYTHON=/path/to/python3.12 demo

BIN := .venv/bin
export PYTHON

.PHONY: demo test lint format install lock clean

demo: install
	@$(BIN)/isogal run --out out/demo $(ARGS)

# Each worker has its own ROS domain (tests/conftest.py); loadfile keeps the tests of a file, and so their fixtures, together.
test: install
	@$(BIN)/python -m pytest -n 2 --dist loadfile $(ARGS)

lint: install
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

format: install
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

install:
	@.ci/setup-venv

# One lock file for both Python versions (environment markers), one for the pip-only needs in docker/; the resolver has a venv of its own.
COMPILE = build/lock/bin/uv pip compile --quiet --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock"
lock:
	@test -x build/lock/bin/uv || { $(or $(PYTHON),python3) -m venv build/lock && build/lock/bin/pip install --quiet uv; }
	@$(COMPILE) --universal --python-version 3.11 requirements.in -o requirements.lock
	@$(COMPILE) --python-version 3.12 --python-platform x86_64-manylinux_2_39 --constraint docker/apt-versions.txt \
	  $(addprefix --no-emit-package ,$(shell sed -n 's/==.*//p' docker/apt-versions.txt)) docker/requirements.in -o docker/requirements.lock

clean:
	rm -rf .venv .venv.flock build out .pytest_cache .ruff_cache .mypy_cache .hypothesis ros2_ws/build ros2_ws/install ros2_ws/log
	find src tests benchmarks docs -name __pycache__ -type d -prune -exec rm -rf {} +
	find src -name '*.egg-info' -type d -prune -exec rm -rf {} +
