# `make demo` renders the example scene; `make test` checks everything. Both work on a fresh clone,
# given Rust (cargo, clippy, rustfmt) and Python 3.11 or later.

PYTHON ?= python3
NPM ?= npm
DATA ?= ../shared/data# photos for tests, scores and training, where it is there
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check
PY := cd python && ../$(BIN)/python -m
LIVEVIEW := target/release/liveview
SCENE := tests/scenes/workshop
RIG := tests/scenes/rig
RUFF := --config python/pyproject.toml python tests crates/python

.PHONY: demo demo-video build runtime setup clean test lint test-rust test-python test-browser parity stability \
	fuzz mutants attack evaluate report models paper

### Use

## The three uses, each on the example scene, and a table of what they gave: python/tools/demo.py.
demo: build runtime
	$(PYTHON) python/tools/demo.py

## The held-out camera of the example rig's clip: a video if ffmpeg is installed, else its frames.
DEMO_VIDEO := out/$(if $(shell command -v ffmpeg),rig.mp4,rig)
demo-video: build runtime
	mkdir -p out
	$(LIVEVIEW) video $(RIG) --camera target --fps 10 -o $(DEMO_VIDEO)
	@echo "Open $(DEMO_VIDEO)."

### Build

## The program, target/release/liveview.
build:
	cargo build --release --locked

## ONNX Runtime: the library from its wheel, without the wheel's dependencies.
runtime: $(VENV)/.runtime

## The Python reference, training and test tools. WITH=evaluation, openvino or ray adds what these need.
setup: $(VENV)/.setup $(WITH:%=setup-%)

## Removes everything that make has created.
clean:
	rm -rf target out $(VENV) .venv-openvino .venv-cuda .venv-ray tests/fuzz/corpus tests/fuzz/artifacts

### Check

## Everything that CI checks, two parts at a time.
test: export OMP_NUM_THREADS = 1# torch's threads wait for each other by spinning
test:
	$(MAKE) --jobs=2 lint test-python test-rust parity

## rustfmt, clippy, rustdoc, ruff, import-linter, and the fuzz targets compiled; warnings are errors.
# Nothing of the fuzz targets is linked, so libFuzzer is not built.
lint: setup
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo clippy --locked --features cuda,tensorrt -- -D warnings
	cargo clippy --locked -p liveview-cli --no-default-features -- -D warnings
	cargo clippy --locked -p liveview --no-default-features -- -D warnings
	cargo clippy --locked -p liveview-python -- -D warnings
	CUSTOM_LIBFUZZER_PATH=/dev/null cargo clippy --locked -p liveview-fuzz -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items
	$(BIN)/ruff check $(RUFF)
	$(BIN)/ruff format --check $(RUFF)
	cd python && ../$(BIN)/lint-imports --no-cache

## Rust tests; ignored tests whose data is installed run as well.
test-rust: runtime build
	cargo test --release --locked
	test ! -d $(DATA) || LIVEVIEW_DATA=$(abspath $(DATA)) cargo test --release --locked --test scenes -- --ignored

## Python tests, including those of the program, of the evaluation, and of every stage of the library against the reference.
test-python: test-python-others test-python-binding

## The page of `bake` and `view`, in a headless Chromium that npm fetches (Node 20 or later), with software WebGL. Not part of `test`.
test-browser: build runtime
	@command -v $(NPM) > /dev/null || { echo "test-browser: npm is missing; expected Node 20 or later" >&2; exit 2; }
	cd tests/browser && $(NPM) ci --silent && LIVEVIEW_DATA=$(abspath $(DATA)) node test.js $(SCENES)

## Every stage of a picture: Rust and float32 torch against float64. The search is compared on a small scene that takes every decision.
PARITY = export $(KEEP_MEMORY) && $(PY) liveview_ref.parity ../$(SCENE)
parity: wheel
	$(PARITY) --target target_0 --layers guided:4
	$(PARITY) --target target_1 --views 5 --layers planes:6
	$(PARITY) --target target_0 --layers guided:2 --precision int8
	$(PARITY) --target target_0 --search-width 0
	$(PARITY) --target target_0 --layers surface:2 --network model
	$(PARITY) --target target_0 --layers planes:16 --alpha competing
	$(PARITY:workshop=walls) --target target --both-ways
	$(STABILITY) --short > target/stability.md
	test ! -e .venv-openvino/.runtime || for precision in f32 int8; do \
		( $(PARITY) --target target_0 --layers guided:2 --engine openvino --precision $$precision ) || exit 1; done

## Stiff and extreme cases: Rust, torch, kornia and onnxruntime against float64. Writes parity/stability.md; the cases: target/.
STABILITY = PYTHONPATH=python $(BIN)/python -m liveview_ref.parity.stability $(SCENE) --target target_0
stability: wheel
	$(STABILITY) --cases target/stability_cases.md > target/stability.md
	cp target/stability.md parity/stability.md

## Damaged files for every reader, FUZZ_RUNS in all (nightly Rust). Inputs that break one stay in tests/fuzz/artifacts.
# No sanitizer: the readers are safe Rust, whose panics, hangs and memory use libFuzzer detects.
FUZZ_RUNS ?= 10000000
FUZZ_TARGETS := $(basename $(notdir $(wildcard tests/fuzz/fuzz_targets/*.rs)))
fuzz:
	cargo fuzz --version > /dev/null 2>&1 || cargo install cargo-fuzz --locked --version 0.13.2
	for target in $(FUZZ_TARGETS); do \
		mkdir -p tests/fuzz/corpus/$$target && \
		cargo +nightly fuzz run --fuzz-dir tests/fuzz --sanitizer none $$target tests/fuzz/corpus/$$target tests/fuzz/seeds/$$target \
			-- -runs=$$(($(FUZZ_RUNS) / $(words $(FUZZ_TARGETS)) + 1)) -timeout=10 -print_final_stats=1 || exit 1; \
	done

## Faults that a test must find: those by name, then one in 400 that cargo-mutants makes, by the day. SHARE=0/1: all of them, for days.
# What is missed is printed; not all of it changes anything: tests/mutants/equivalent.md.
SHARE ?= $(shell date +%j)/400
MUTANTS = CARGO_TARGET_DIR=$(abspath target) cargo mutants --dir target/mutants/tree --in-place --config tests/mutants/mutants.toml --output target/mutants \
	--sharding round-robin --shard $(SHARE)
mutants: runtime
	cargo mutants --version > /dev/null 2>&1 || cargo install cargo-mutants --locked --version 27.1.0
	$(PYTHON) tests/mutants/faults.py
	$(MUTANTS) -p liveview -- --lib --test goldens --test renderer || case $$? in 2 | 3) ;; *) exit 1 ;; esac
	$(MUTANTS) -p liveview-surface -- --lib || case $$? in 2 | 3) ;; *) exit 1 ;; esac

## 2,000 hostile runs of the program and 500 requests to the viewer; `make test` has a fifth of them.
attack: runtime build
	ATTACKS=2000 cargo test --release --locked -p liveview-cli --test hostile -- --nocapture

### Measure: steps by name, python/steps.mk

## PSNR, SSIM, LPIPS and tearing on 21 scenes of DATA, with a contact sheet of each: out/scenes. OPTIONS of `render`; SCENES.
evaluate: setup-evaluation build
	$(PY) liveview_ref.evaluation.scenes configs/scenes.json --data $(abspath $(DATA)) --out ../out/scenes \
		$(if $(SCENES),--scenes $(SCENES)) $(if $(OPTIONS),--options="$(OPTIONS)")

## This machine's figures: STEP=sweep (error against run time, the default), live or readme.
report: report-$(or $(STEP),sweep)

## The shipped models: STEP=evaluate (their scores on DATA, the default), cards, int8 or train.
models: models-$(or $(STEP),evaluate)

## The comparison with the paper: STEP=report (its page, the default), scenes, train, score, cost or departures.
paper: paper-$(or $(STEP),report)

include python/steps.mk
