# `make demo` renders the example scene; `make test` proves everything. Both work on a fresh clone, given Rust (cargo, clippy,
# rustfmt) and Python 3.11 or later.

PYTHON ?= python3
comma := ,
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check
LIVEVIEW := target/release/liveview
SCENE := tests/scenes/workshop
RIG := tests/scenes/rig
DATA ?= ../shared/data
RUFF := --config python/pyproject.toml python parity tests

NPM ?= npm

.PHONY: demo demo-stereo demo-video test test-browser build runtime runtime-openvino setup-ray int8 report setup lint docs goldens test-rust \
	test-python parity stability readme live-report cards setup-evaluation evaluate limits paper-scenes paper-train paper-keep paper-score \
	paper-cost paper-departures paper-report fuzz clean

## Render the two held-out views of the example scene and compare them with the truth.
demo: build runtime
	mkdir -p out
	$(LIVEVIEW) render $(SCENE) --target target_0,target_1 -o out/views --compare out/compare --depth out/depth
	@echo "Open out/views, out/compare (truth, result, difference) and out/depth."

## Two photos alone: the middle between the views of the Middlebury motorcycle pair (from scikit-image), by V = 2.
demo-stereo: build setup
	cd python && ../$(BIN)/python -m tools.make_stereo_scene ../out/motorcycle
	$(LIVEVIEW) render out/motorcycle --views 2 --path line:5 -o out/stereo --depth out/stereo_depth
	@echo "Open out/stereo: from one photo to the other in five steps."

## The held-out camera of the example rig's clip, from the others; a video where there is ffmpeg, else its frames.
DEMO_VIDEO := out/$(if $(shell command -v ffmpeg),rig.mp4,rig)
demo-video: build runtime
	mkdir -p out
	$(LIVEVIEW) video $(RIG) --camera target --layers surface:1 --fps 10 -o $(DEMO_VIDEO)
	@echo "Open $(DEMO_VIDEO)."

## Everything that CI checks.
test: lint docs test-python test-rust parity

build:
	cargo build --release --locked

## ONNX Runtime alone: the library inside its wheel, without anything that the wheel pulls in.
runtime: $(VENV)/.runtime
$(VENV)/.runtime: python/requirements-runtime.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --no-deps -r $<
	touch $@

## ONNX Runtime with OpenVINO, for `--engine openvino`; optional.
runtime-openvino: .venv-openvino/.runtime
.venv-openvino/.runtime: python/requirements-openvino.txt
	test -x .venv-openvino/bin/python || $(PYTHON) -m venv .venv-openvino
	.venv-openvino/bin/pip install --quiet --disable-pip-version-check --no-deps -r $<
	touch $@

## Ray, for python/tools/render_on_ray.py and its test; optional.
setup-ray: .venv-ray/.setup
.venv-ray/.setup: python/requirements-ray.txt
	test -x .venv-ray/bin/python || $(PYTHON) -m venv .venv-ray
	.venv-ray/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@

## The Python reference, its training and all test tools.
setup: $(VENV)/.setup
$(VENV)/.setup: python/requirements.txt python/constraints.txt $(VENV)/.runtime
	$(PIP) -r $<
	touch $@

# The fuzz targets on stable Rust, in a folder of their own: the flag would have everything else compiled anew. Nothing is
# linked, so libFuzzer is not built.
CHECK_FUZZ = CUSTOM_LIBFUZZER_PATH=/dev/null RUSTFLAGS="--cfg fuzzing" cargo check --locked --manifest-path tests/fuzz/Cargo.toml \
	--target-dir target/fuzzing

lint: setup
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo clippy --locked --features cuda,tensorrt -- -D warnings
	$(CHECK_FUZZ)
	$(BIN)/ruff check $(RUFF)
	$(BIN)/ruff format --check $(RUFF)

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items

## Seeded goldens for tests/parity; made anew when the reference changes.
goldens: target/goldens/cases.txt
REFERENCE := $(wildcard python/liveview_ref/*.py python/liveview_ref/reference/*.py python/liveview_ref/reference/*/*.py \
	python/liveview_ref/parity/*.py)
target/goldens/cases.txt: parity/generate.py $(REFERENCE) | setup
	$(BIN)/python parity/generate.py target/goldens

## What needs more than a clone is ignored by `cargo test`, and asked for here where it is there.
test-rust: setup goldens
	cargo test --release --locked
	test ! -d $(DATA) || LIVEVIEW_DATA=$(abspath $(DATA)) cargo test --release --locked --test scene -- --ignored
	test ! -e .venv-openvino/.runtime || cargo test --release --locked --test execution_providers -- --ignored

## Those of the program and of the evaluation too: without both they would be skipped.
test-python: setup-evaluation build
	cd python && ../$(BIN)/python -m pytest -q

## `liveview view` driven by a headless Chromium, which npm fetches (Node 20 or later; CHROMIUM names another). Not part of `test`.
test-browser: build runtime
	@command -v $(NPM) > /dev/null || { echo "test-browser: npm is missing; expected Node 20 or later" >&2; exit 2; }
	cd tests/browser && $(NPM) ci --silent && node test.js

## Every stage of the example scene, live: Rust and float32 torch against float64.
parity: build setup
	cd python && ../$(BIN)/python -m liveview_ref.parity ../$(SCENE) --target target_0 --layers guided:4
	cd python && ../$(BIN)/python -m liveview_ref.parity ../$(SCENE) --target target_1 --views 5 --layers planes:6
	cd python && ../$(BIN)/python -m liveview_ref.parity ../$(SCENE) --target target_0 --layers guided:2 --precision int8
	cd python && ../$(BIN)/python -m liveview_ref.parity ../$(SCENE) --target target_0 --layers surface:2
	cd python && ../$(BIN)/python -m liveview_ref.parity ../$(SCENE) --target target_0 --network none
	cd python && ../$(BIN)/python -m liveview_ref.parity ../$(SCENE) --target target_0 --layers planes:32 --alpha competing
	$(STABILITY) --short > target/stability.md
	test ! -e .venv-openvino/.runtime || for precision in f32 int8; do ( cd python && ../$(BIN)/python -m \
		liveview_ref.parity ../$(SCENE) --target target_0 --layers guided:2 --engine openvino --precision $$precision ) || exit 1; done

## Stiff and extreme cases: Rust, torch, kornia and onnxruntime against float64; the table and the plot in parity/.
STABILITY = PYTHONPATH=python $(LIVEVIEW) stability $(SCENE) --target target_0 --threads 1 \
	--reference "$(BIN)/python -m liveview_ref.parity.stability"
stability: build setup
	$(STABILITY) -o parity

## Error against run time, measured on this machine (half an hour, best on an idle one): models/report, then README.md.
ENGINES := cpu int8$(if $(wildcard .venv-openvino/.runtime),$(comma)openvino f32$(comma)openvino int8)
report: build setup
	for v in 4 5; do \
		PYTHONPATH=python $(LIVEVIEW) sweep $(SCENE) --target target_0,target_1 --views $$v --engines "$(ENGINES)" \
			--reference "$(BIN)/python -m liveview_ref.competitors.worker" --repetitions 3 -o models/report/v$$v || exit 1; \
	done
	$(LIVEVIEW) sweep $(SCENE) --target target_0 --layers guided:2,guided:4,planes:8,planes:16 --widths 504,800,1200,1760 \
		--repetitions 3 -o models/report/scaling
	$(MAKE) readme

## The layer policies of `liveview video` on the rig clip, and memory over 1,000 frames: models/report/live.
live-report: build setup
	cd python && ../$(BIN)/python -m tools.live_report --cut 11 -- $(if $(wildcard .venv-openvino/.runtime),--engine openvino --precision int8)

## The numbers and the pictures of README.md, from models/report, the example scene and the example rig.
readme: build setup
	cd python && ../$(BIN)/python -m tools.readme

## The tables of models/README.md and the training curves, from the weights and the scores that lie there.
cards: setup
	cd python && ../$(BIN)/python -m tools.cards

## The table of models/README.md of what limits the pictures, from the example scene, whose depth is known.
limits: build setup
	cd python && ../$(BIN)/python -m tools.limits

## The int8 models and their cards, anew, from the float32 ones; takes minutes each, and DATA.
int8: setup
	cd python && for v in 2 4 5 10 4_planes 4_planes_paper; do \
		../$(BIN)/python -m liveview_ref.quantize ../models/liveview_v$$v.onnx ../models/liveview_v$${v}_int8.onnx \
			configs/v$$v.json --data $(abspath $(DATA)) || exit 1; \
	done

## What `evaluate` and `paper-report` need beyond `setup`: OpenCV, OpenEXR, and the weights of LPIPS without the packages (jax) they were made for.
setup-evaluation: $(VENV)/.evaluation
$(VENV)/.evaluation: python/requirements-evaluation.txt $(VENV)/.setup
	$(PIP) --no-deps -r $<
	touch $@

## Scores of every model against baselines, beside the model: tables, contact sheet, figure. Surface layers are rendered by the
## program, with the network and without one. Scenes that DATA lacks are
## skipped; the example scene is always there.
evaluate: setup-evaluation build
	cd python && for model in ../models/*.pt; do \
		../$(BIN)/python -m liveview_ref.evaluation.evaluate $$model configs/evaluation.json --data $(abspath $(DATA)) \
			--out $${model%.pt}_scores || exit 1; \
	done

## The paper's comparisons, made anew (docs/paper.md): the rig's scenes; every method trained on them in turns, which may be stopped
## and started again; their scores, times and departures, in models/paper; and the page, from those files alone.
PAPER_RUNS ?= out/paper
PAPER := cd python && ../$(BIN)/python -m liveview_ref.paper
PAPER_SCENES := --scenes $(abspath $(PAPER_RUNS))/scenes --textures $(abspath $(DATA))/textures
paper-scenes: setup
	$(PAPER).scenes $(abspath $(PAPER_RUNS))/scenes $(abspath $(DATA))/textures

# glibc would give large tensors back to the system and fault their pages in anew at every step: LiveView, V = 4: 1.3 core seconds
# a step with these, 1.6 to 2.0 without.
KEEP_MEMORY := MALLOC_MMAP_THRESHOLD_=8589934592 MALLOC_TRIM_THRESHOLD_=17179869184 MALLOC_TOP_PAD_=268435456
paper-train: paper-scenes
	export $(KEEP_MEMORY) && $(PAPER).train $(PAPER_SCENES) --out $(abspath $(PAPER_RUNS))/runs

## The averaged weights of what was trained, the small ones, in models/paper/weights, and their card.
paper-keep: setup
	$(PAPER).cards --runs $(abspath $(PAPER_RUNS))/runs

paper-score: setup-evaluation
	$(PAPER).score $(PAPER_SCENES) --runs $(abspath $(PAPER_RUNS))/runs --out ../models/paper/scores

paper-cost: setup build
	$(PAPER).cost --out ../models/paper/cost.json

paper-departures: setup
	$(PAPER).departures $(PAPER_SCENES) --runs $(abspath $(PAPER_RUNS))/runs --out ../models/paper/departures.json

paper-report: setup
	$(PAPER).report
	$(PAPER).cards
	cd python && ../$(BIN)/python -m tools.paper_headline

## Damaged files for every reader, FUZZ_SECONDS each; needs nightly Rust. What breaks one is kept in tests/fuzz/artifacts.
## No sanitizer: the readers are safe Rust, which can panic, hang or take memory, and all three are caught.
FUZZ_SECONDS ?= 60
FUZZ_TARGETS := $(basename $(notdir $(wildcard tests/fuzz/fuzz_targets/*.rs)))
fuzz:
	cargo fuzz --version > /dev/null 2>&1 || cargo install cargo-fuzz --locked --version 0.13.2
	for target in $(FUZZ_TARGETS); do \
		mkdir -p tests/fuzz/corpus/$$target && \
		cargo +nightly fuzz run --fuzz-dir tests/fuzz --sanitizer none $$target tests/fuzz/corpus/$$target tests/fuzz/seeds/$$target \
			-- -max_total_time=$(FUZZ_SECONDS) -timeout=10 -print_final_stats=1 || exit 1; \
	done

clean:
	rm -rf target out $(VENV) .venv-openvino .venv-cuda .venv-ray tests/fuzz/target tests/fuzz/corpus tests/fuzz/artifacts
