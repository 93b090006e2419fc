# Rarely used recipes: `make wheel`, `make goldens`, what `make setup WITH=` adds, and the steps of `make report`, `models` and `paper`.

$(VENV)/.runtime: python/requirements-runtime.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --no-deps -r $<
	touch $@

$(VENV)/.setup: python/requirements.txt python/constraints.txt $(VENV)/.runtime
	$(PIP) -r $<
	touch $@

# --- the Python package ---

.PHONY: wheel

## The Python package liveview (docs/python.md): target/wheels.
wheel: setup build
	$(BIN)/maturin build --quiet --release --locked --manifest-path crates/python/Cargo.toml --out target/wheels

# --- make test-python, in two parts that may run side by side ---

.PHONY: test-python-binding test-python-others

## Tests of the package liveview: half of the time.
test-python-binding: setup-evaluation build wheel
	$(PY) pytest -q tests/binding

test-python-others: setup-evaluation build wheel
	$(PY) pytest -q --ignore tests/binding

# --- the cases of tests/goldens.rs ---

.PHONY: goldens

## parity/goldens, from the float64 reference: what `cargo test` compares the runtime with. FOLDER: where else to write them.
goldens: setup
	$(PY) liveview_ref.parity.goldens $(FOLDER)

# --- make setup WITH= ---

.PHONY: setup-evaluation setup-openvino setup-ray

## Scores: OpenCV, and the weights of LPIPS without the package (jax) that they were made for.
setup-evaluation: $(VENV)/.evaluation
$(VENV)/.evaluation: python/requirements-evaluation.txt $(VENV)/.setup
	$(PIP) --no-deps -r $<
	touch $@

# `$(call separate,NAME)` is the recipe of an environment of its own, .venv-NAME.
define separate
	test -x .venv-$(1)/bin/python || $(PYTHON) -m venv .venv-$(1)
	.venv-$(1)/bin/pip install --quiet --disable-pip-version-check $(2) -r $<
	touch $@
endef

## ONNX Runtime with OpenVINO, for `--engine openvino`.
setup-openvino: .venv-openvino/.runtime
.venv-openvino/.runtime: python/requirements-openvino.txt
	$(call separate,openvino,--no-deps)

## Ray Data, for crates/python/examples/on_ray.py and its test.
setup-ray: .venv-ray/.setup
.venv-ray/.setup: python/requirements-ray.txt
	$(call separate,ray)

# --- make report STEP= ---

.PHONY: report-sweep report-live report-readme

## Error against run time (a quarter of an hour on an idle machine): models/report, then the readme step.
report-sweep: build setup setup-openvino wheel
	for v in 4 5; do \
		$(LIVEVIEW) sweep $(SCENE) --target target_0,target_1 --views $$v --engines "cpu int8,openvino f32,openvino int8" \
			--repetitions 3 -o models/report/v$$v || exit 1; \
		PYTHONPATH=python $(BIN)/python -m liveview_ref.competitors models/report/v$$v/sweep.json \
			--model models/liveview_v$$v.onnx || exit 1; \
	done
	$(LIVEVIEW) sweep $(SCENE) --target target_0 --layers guided:2,guided:4,planes:8,planes:16 --widths 504,800,1200,1760 \
		--repetitions 3 -o models/report/scaling
	$(MAKE) report STEP=readme

## The layer policies of `liveview video` on the rig's clip, and memory over 1,000 frames: models/report/live.
report-live: build setup setup-openvino
	$(PY) tools.live_report --cut 11 -- --engine openvino --precision int8

## The figures and pictures of README.md and docs/, from models/report, the example scene and the example rig.
report-readme: build wheel
	$(PY) tools.readme

# --- make models STEP= ---

.PHONY: models-evaluate models-cards models-int8 models-train

# The float32 models that the reference scores and that have an int8 twin.
NETWORKS := $(filter-out %_int8 %_surface,$(basename $(notdir $(wildcard models/*.onnx))))

## Scores of every float32 model against baselines, in the folder beside it (of the one for surface layers: `make evaluate`).
## Scenes that DATA lacks are skipped; the example scene is part of the repository.
models-evaluate: setup-evaluation wheel
	cd python && for model in $(NETWORKS); do \
		../$(BIN)/python -m liveview_ref.evaluation.evaluate ../models/$$model.onnx configs/evaluation.json \
			--data $(abspath $(DATA)) --out ../models/$${model}_scores || exit 1; \
	done

## The tables of models/README.md and the training curves, from the records and scores in models/.
models-cards: setup
	$(PY) tools.cards

## The int8 models and their cards, from the float32 ones and DATA; minutes each.
models-int8: setup
	cd python && for model in $(NETWORKS); do \
		../$(BIN)/python -m liveview_ref.quantize ../models/$$model.onnx ../models/$${model}_int8.onnx \
			configs/$${model#liveview_}.json --data $(abspath $(DATA)) || exit 1; \
	done

## Every network by python/configs/recipe.json, one after another, in TRAIN_RUNS: run it again to go on. ONLY=CONFIG trains one,
## from the shipped network that it starts from. Hours to days; it leaves the processor to other work.
TRAIN_RUNS ?= out/train
models-train: wheel
	export $(KEEP_MEMORY) && cd python && exec nice -n 19 ../$(BIN)/python -m liveview_ref.training.recipe configs/recipe.json \
		--data $(abspath $(DATA)) --out $(abspath $(TRAIN_RUNS)) $(if $(ONLY),--only $(ONLY))

# --- make paper STEP= (docs/paper-comparison.md) ---

.PHONY: paper-scenes paper-train paper-score paper-cost paper-departures paper-report

PAPER_RUNS ?= out/paper
PAPER := $(PY) liveview_ref.paper
PAPER_SCENES := --scenes $(abspath $(PAPER_RUNS))/scenes --textures $(abspath $(DATA))/textures
RUNS := --runs $(abspath $(PAPER_RUNS))/runs

## The rig's scenes.
paper-scenes: setup
	$(PAPER).data.scenes $(abspath $(PAPER_RUNS))/scenes $(abspath $(DATA))/textures

## Every method in turns, on these scenes; can be stopped and started again.
# glibc would return large tensors to the system and fault their pages in again at every step: LiveView, V = 4, takes 1.3 core
# seconds a step with these, 1.6 to 2.0 without.
KEEP_MEMORY := MALLOC_MMAP_THRESHOLD_=8589934592 MALLOC_TRIM_THRESHOLD_=17179869184 MALLOC_TOP_PAD_=268435456
paper-train: paper-scenes
	export $(KEEP_MEMORY) && $(PAPER).train $(PAPER_SCENES) --out $(abspath $(PAPER_RUNS))/runs

## Scores of what is trained so far: models/paper/scores_rig.json.
paper-score: setup-evaluation wheel
	$(PAPER).measure.score $(PAPER_SCENES) $(RUNS) --out ../models/paper

## Times, operations and memory of every method: models/paper/cost.json.
paper-cost: setup build
	$(PAPER).measure.cost --out ../models/paper/cost.json

## The effect of single departures from the paper: models/paper/departures.json.
paper-departures: setup
	$(PAPER).measure.departures $(PAPER_SCENES) $(RUNS) --out ../models/paper/departures.json

## The page, from models/paper.
paper-report: setup
	$(PAPER).report.page

# An unknown step or WITH.
setup-%:
	@echo "make setup WITH=$*: expected evaluation, openvino or ray" >&2; exit 2
report-%:
	@echo "make report STEP=$*: expected sweep, live or readme" >&2; exit 2
models-%:
	@echo "make models STEP=$*: expected evaluate, cards, int8 or train" >&2; exit 2
paper-%:
	@echo "make paper STEP=$*: expected report, scenes, train, score, cost or departures" >&2; exit 2
