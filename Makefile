# Every target sets up .venv by itself; nothing else is needed on a fresh machine but Python >= 3.11.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.installed
DEV    := $(VENV)/.installed-dev
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo test campaign check docs bench bench-first bench-batch bench-long bench-open bench-app format clean
.DEFAULT_GOAL := demo

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	$(BIN)/python -m stereocalib_core.system.warmup > /dev/null
	@touch $@

$(DEV): $(READY)
	$(PIP) -e '.[dev]'
	@touch $@

demo: $(READY)  ## the app on the embedded synthetic drive
	$(BIN)/stereocalib demo $(ARGS)

test: $(DEV)  ## every test; browser tests need a Chromium or Chrome on the machine
	$(BIN)/python -m pytest -n 2 --dist loadfile $(ARGS)

campaign: $(DEV)  ## damaged files, hostile messages, kills and floods by the thousand: a quarter of an hour
	$(BIN)/python tests/campaign

check: $(DEV)  ## format, lint, types, arrows between the rooms
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest tests/app/test_house.py

docs: $(DEV)  ## the documentation as a site in build/site
	$(PIP) -e '.[docs]'
	$(BIN)/mkdocs build --quiet

bench: $(DEV)  ## speeds as ratios to an SGBM yardstick measured in the same run; two workers; how quick the page is
	$(BIN)/python -m stereocalib_core.benches.front_end $(ARGS)
	$(BIN)/python -m stereocalib_core.benches.batch --workers-only --drives 6 --frames 100
	$(BIN)/python -m stereocalib_core.benches.pair_and_lidar
	$(BIN)/python -m stereocalib_app.benches.page

bench-long: $(READY)  ## memory and time of long drives, their frames made by repeating a short one's
	$(BIN)/python -m stereocalib_core.benches.long_drive $(ARGS)

bench-open: $(DEV)  ## the first moving picture of the demo, and the page of a drive of an hour
	$(BIN)/python -m stereocalib_app.benches.first_seconds
	$(BIN)/python -m stereocalib_app.benches.long_page

bench-first: $(READY)  ## the first run on a machine, with everything to compile, and the next
	$(BIN)/python -m stereocalib_core.benches.first_run $(ARGS)

bench-batch: $(DEV)  ## twelve short drives: one run after another, one worker, two workers
	$(BIN)/python -m stereocalib_core.benches.batch $(ARGS)

bench-app: $(DEV)  ## how quick the page is, and a class of twenty browsers, on RUN=the output of a run
	$(BIN)/python -m stereocalib_app.benches.page $(RUN)
	$(BIN)/python -m stereocalib_app.benches.classroom $(RUN)

format: $(DEV)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache
