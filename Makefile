# Needs Linux x86-64, make and Python 3.11 or 3.12 with venv; everything else goes into .venv:
# requirements.lock for the demo, requirements-development.lock besides for tests and checks.
#   make demo           the default scenario as four node processes and a recorder; see out/demo/
#   make test [ARGS="tests/cli -k help"]   the test suite
#   make wheel-test   build and install the library alone, and match a track with it
#   make accept [ARGS=--quick]   accuracy, honesty and cost in one table, beside the kept one
#   make coverage     which lines and branches of the library the tests reach
#   make docs         the documentation as a site, in build/site
#   make test-docs    all commands of README and docs (minutes)
#   make lint | format | lock | clean
# A particular interpreter: make PYTHON=/path/to/python3.12 demo

BIN := .venv/bin
export PYTHON
# What is installed is compiled to bytecode when it is first imported: only what is used, and once.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test coverage test-docs wheel-test docs accept lint format install install-development lock clean

demo: install
	@$(BIN)/isogal run --out out/demo $(ARGS)

# Each worker has its own ROS domain (tests/ros/conftest.py); loadfile keeps the tests of a file,
# and so their fixtures, together, in the order of tests/conftest.py: what takes long first. One
# worker more than two cores, since a sixth of the time is spent waiting for processes.
test: install-development
	@$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(ARGS)

# Branch coverage of the library, by all tests (twice as long as these) or some: ARGS="tests/maps".
coverage: install-development
	@$(BIN)/python -c "import coverage" 2> /dev/null || $(BIN)/pip install --quiet "coverage>=7.10"
	@mkdir -p build/coverage
	@$(BIN)/python -m coverage erase
	@$(BIN)/python -m coverage run -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(ARGS)
	@$(BIN)/python -m coverage combine --quiet
	@$(BIN)/python -m coverage report $(if $(ARGS),--fail-under=0)

# The library as anybody gets it: wheel and sdist built and installed without ROS.
wheel-test:
	@.ci/wheel-test

# All that a change of the matcher must not make worse, in two hours (benchmarks/acceptance.json);
# with --quick in ten minutes. It goes on where it was interrupted.
accept: install-development
	@$(BIN)/python benchmarks/acceptance.py $(ARGS)

# The documentation as a site, in build/site; its tools have a venv of their own.
docs:
	@test -x build/docs/bin/mkdocs || \
	  { $(or $(PYTHON),python3) -m venv build/docs && \
	    build/docs/bin/pip install --quiet "mkdocs-material>=9.5" "mkdocstrings-python>=2.0" \
      latex2mathml; }
	@NO_MKDOCS_2_WARNING=1 build/docs/bin/mkdocs build --quiet

# The demo, which the README begins with, and then the commands of the pages
# (tests/helpers/pages.py).
DOCUMENTS = README.md $(wildcard docs/*.md docs/tutorials/*.md)
test-docs: install-development demo
	@$(BIN)/python tests/helpers/run_pages.py $(DOCUMENTS)

lint: install-development
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@! grep -q '^\[tool\.importlinter\]' pyproject.toml || $(BIN)/lint-imports --no-logo

format: install-development
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

install:
	@.ci/setup-venv

install-development:
	@.ci/setup-venv development

# Installed by Ubuntu with python3-matplotlib.
WITH_APT = contourpy cycler fonttools kiwisolver pillow
# One lock for both Python versions (environment markers) for each of the three purposes, and one
# for the pip-only needs in docker/; the resolver has a venv of its own.
COMPILE = build/lock/bin/uv pip compile --quiet --no-emit-index-url \
  --no-emit-find-links --custom-compile-command "make lock"
COMPILE_BOTH = $(COMPILE) --universal --python-version 3.11 --generate-hashes
lock:
	@test -x build/lock/bin/uv || \
	  { $(or $(PYTHON),python3) -m venv build/lock && build/lock/bin/pip install --quiet uv; }
	@$(COMPILE_BOTH) requirements.in -o requirements.lock
	@$(COMPILE_BOTH) requirements-development.in -o requirements-development.lock
	@$(COMPILE_BOTH) requirements-installer.in -o requirements-installer.lock
	@$(COMPILE) --generate-hashes --python-version 3.12 --python-platform x86_64-manylinux_2_39 \
	  --constraint docker/apt-versions.txt \
	  $(addprefix --no-emit-package ,$(shell sed -n 's/==.*//p' docker/apt-versions.txt)) \
	  $(addprefix --no-emit-package ,$(WITH_APT)) \
	  docker/requirements.in -o docker/requirements.lock

clean:
	rm -rf .venv .venv.flock build out .pytest_cache .ruff_cache .mypy_cache .hypothesis \
	  .import_linter_cache ros2_ws/build ros2_ws/install ros2_ws/log
	find src tests benchmarks docs -name __pycache__ -type d -prune -exec rm -rf {} +
	find src -name '*.egg-info' -type d -prune -exec rm -rf {} +
