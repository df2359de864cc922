"""Breaks of what trains, saves and opens runs: motion_jax/training, runs.py, fit.py, loading.py and configs."""
BUDGET, PREFETCH, GUARDS, SAVER = (f"tests/training/test_{name}.py" for name in (
    "budget", "prefetch", "guards", "saver"))
REPORT, OPTIMIZERS, SETUP, START, STEP = (f"tests/training/test_{name}.py" for name in (
    "report_of_a_run", "optimizers", "setup", "train_start", "train_step"))
RUNS, RECIPES, FACTS = "tests/test_runs.py", "tests/configs/test_shipped_recipes.py", "tests/configs/test_config_facts.py"

MUTATIONS = (
    ("training-deadline-left", "motion_jax/training/budget.py", "return step if left > cooldown else",
     "return step if left > 2 * cooldown else", (BUDGET,)),
    ("training-rollback-refunds", "motion_jax/training/budget.py", "self._spent = max(self._spent, spent)",
     "self._spent = spent", (BUDGET,)),
    ("training-linear-after-warm-up", "motion_jax/training/optimizers.py",
     "config.final_rate / peak, max(num_steps - warmup, 1), warmup)", "config.final_rate / peak, num_steps, 0)",
     (OPTIMIZERS,)),
    ("training-released-warm-up", "motion_jax/training/optimizers.py", "jnp.minimum(step + 2, warmup)",
     "jnp.minimum(step + 1, warmup)", (OPTIMIZERS,)),
    ("training-rate-below-a-name", "motion_jax/training/optimizers.py", "update * _rate(path, rates)",
     "update / _rate(path, rates)", (OPTIMIZERS,)),
    ("training-clip-parts", "motion_jax/training/optimizers.py", '| {"rest": optax.identity()}', '| {"rest": clip}',
     (OPTIMIZERS,)),
    ("training-spike-history", "motion_jax/training/train_step.py", "jnp.append(state.norms[1:], norm)",
     "jnp.append(state.norms[:-1], norm)", (GUARDS,)),
    ("training-part-of-a-step", "motion_jax/training/train_step.py", "jnp.add, found, of_rows(rows))",
     "jnp.maximum, found, of_rows(rows))", ("tests/training/test_train.py",)),
    ("training-epoch-counts-whole-batches", "motion_jax/training/setup.py",
     "found.train.num_steps = epochs * max(num_items // config.data.batch_size, 1)",
     "found.train.num_steps = epochs * max(-(-num_items // config.data.batch_size), 1)", (FACTS,)),
    ("training-other-std", "motion_jax/training/setup.py", "or not np.allclose(before.std, stats.std, rtol=0.01)",
     "or False", ("tests/test_smoke.py::test_resume_with_other_frozen_parts_is_refused",)),
    ("training-other-words", "motion_jax/training/setup.py",
     'if known is not None and known != json.loads(files[checkpoint.TEXT])["fingerprint"]:', "if False:",
     ("tests/test_smoke.py::test_resume_with_other_frozen_parts_is_refused",)),
    ("training-fit-of-another-layout", "motion_jax/fit.py", "if features != layout.dim:", "if features > layout.dim:",
     (RUNS,)),
    ("training-share-of-a-pass", "motion_jax/fit.py", 'config.get("seconds", 0.0) * one.get("share", 0)',
     'config.get("seconds", 0.0)', (RECIPES,)),
    ("training-exchanged-encoder", "motion_jax/runs.py", '(given["encoder"], own["encoder"])))):',
     '(given["encoder"], given["encoder"])))):', (START,)),
    ("training-parameters-left-out", "motion_jax/runs.py", 'if name.partition("/")[0] in SAMPLED)', ")",
     ("tests/test_shipped_models.py",)),
    ("training-text-of-the-run", "motion_jax/loading.py", "load_text_encoder(text or run.text,",
     "load_text_encoder(run.text,", ("tests/test_damaged_runs.py",)),
    ("training-raw-weights", "motion_jax/loading.py", "tuple(registry.model_stages()), raw)",
     "tuple(registry.model_stages()))", (RUNS,)),
)
