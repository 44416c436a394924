# Every command sets up what it needs first (tools/setup.sh); a second call is quick.
.DEFAULT_GOAL := help
.PHONY: help demo pictures test test-fast test-long lint format types bench docs clean setup-run setup-test setup-docs

bin := .venv/bin
pytest := $(bin)/python -m pytest

help:  ## List the commands.
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1|\2/p' Makefile | awk -F'|' '{printf "%-15s %s\n", $$1, $$2}'

demo: setup-run  ## Simulate the demo scene with a D435; leaves out/demo and out/demo.png.
	$(bin)/starling simulate clutter --sensor d435 --out out/demo --force
	$(bin)/starling show out/demo --out out/demo.png --force

pictures: demo  ## Draw pictures of the documentation: the demo and the sweep.
	$(bin)/python tools/shrink_picture.py out/demo.png docs/pictures/demo.png
	$(bin)/starling sweep --sensor d435 --out out/sweep --force
	$(bin)/python tools/shrink_picture.py out/sweep/sweep.png docs/pictures/sweep.png

test: setup-test  ## Run every test but the long ones; set up with torch.
	$(pytest) -n 2 --dist worksteal

test-fast: setup-test  ## Run the tests that are neither slow nor long.
	$(pytest) -n 2 --dist worksteal -m "not slow and not long"

test-long: setup-test  ## Run the long tests, of up to minutes each.
	$(pytest) -m long

lint: setup-test  ## Check style and format (ruff).
	$(bin)/ruff check .
	$(bin)/ruff format --check .

format: setup-test  ## Mend style and format where ruff can.
	$(bin)/ruff check --fix .
	$(bin)/ruff format .

types: setup-test  ## Check types (pyright).
	$(bin)/pyright

bench: setup-run  ## Time the whole pipeline against the bare floor.
	$(bin)/starling bench

docs: setup-docs  ## Build the documentation into out/site.
	NO_MKDOCS_2_WARNING=1 $(bin)/mkdocs build --quiet --strict

clean:  ## Remove what was made, but for .venv.
	rm -rf out build dist test_artifacts *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

setup-run setup-test setup-docs:
	@sh tools/setup.sh $(@:setup-%=%)
